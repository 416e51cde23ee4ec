"""One room of S3DIS: its points from the room's file, its objects from the annotations, and what was wrong."""

from __future__ import annotations

import re
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.dataset import Finding
from pcdbench.datasets.s3dis.text import read_rows
from pcdbench.errors import CloudError
from pcdbench.scene import Box, TaggedObject

STRUCTURE = frozenset({"ceiling", "floor", "wall", "beam", "column", "clutter"})
LABELS = STRUCTURE | {"window", "door", "table", "chair", "sofa", "bookcase", "board", "stairs"}
ANNOTATIONS = "Annotations"
# A part of a room can stick out of the room's own points by noise, not by more.
_OUTSIDE_M = 1.0


@dataclass(frozen=True, eq=False)
class Room:
    """What the files of a room hold.

    Attributes:
        cloud: all points, in the area's frame, metres.
        objects: one for each annotation, `STRUCTURE` too, in the order of their names.
        findings: what was wrong, and how it was mended.
    """

    cloud: PointCloud
    objects: tuple[TaggedObject, ...]
    findings: tuple[Finding, ...]


def room_files(folder: Path) -> list[Path]:
    """The files that decide a room: its own text file and the annotations, sorted; hidden ones are passed over."""
    return sorted([*_texts(folder), *_texts(folder / ANNOTATIONS)])


def read_room(folder: Path) -> Room:
    """Read a room; where its own file is missing, its points are those of the annotations.

    Raises:
        CloudError: where no point can be read.
    """
    findings: list[Finding] = []
    rows = _room_rows(folder, findings)
    parts = _annotations(folder, findings)
    annotated = np.concatenate([part for _, _, part in parts]) if parts else None
    if rows is None:
        if annotated is None:
            raise CloudError(f"{folder} has neither points nor annotations; unpack the data set again")
        rows = annotated
    elif annotated is not None and len(annotated) != len(rows):
        findings.append(
            Finding(
                _short(folder / ANNOTATIONS),
                f"its files hold {len(annotated):,} points, the room's own {len(rows):,}",
                "points are taken from the room's file, boxes from the annotations",
            )
        )
    objects = []
    low, high = rows[:, :3].min(axis=0), rows[:, :3].max(axis=0)
    for path, label, part in parts:
        least, most = part[:, :3].min(axis=0), part[:, :3].max(axis=0)
        if (least < low - _OUTSIDE_M).any() or (most > high + _OUTSIDE_M).any():
            findings.append(
                Finding(_short(path), "it lies outside its room (in another unit or frame?)", "the object is left out")
            )
            continue
        objects.append(TaggedObject(label, Box((least + most) / 2, most - least)))
    return Room(_cloud(rows, folder, findings), tuple(objects), tuple(findings))


def _room_rows(folder: Path, findings: list[Finding]) -> NDArray[np.float64] | None:
    """The rows of the room's own file, or None where there is none to use."""
    named = folder / f"{folder.name}.txt"
    others = _texts(folder)
    if named not in others:
        done = f"{others[0].name} is taken for it" if len(others) == 1 else "the annotations are taken together"
        findings.append(Finding(_short(named), "there is no such file", done))
        if len(others) != 1:
            return None
        named = others[0]
    rows, found = read_rows(named, _short(named))
    findings += found
    if not len(rows):
        findings.append(Finding(_short(named), "it holds no point", "the annotations are taken together"))
        return None
    return rows


def _annotations(folder: Path, findings: list[Finding]) -> list[tuple[Path, str, NDArray[np.float64]]]:
    """File, label and rows of each annotation that holds points."""
    annotations = folder / ANNOTATIONS
    if not annotations.is_dir():
        findings.append(Finding(_short(annotations), "there is no such folder", "the room has no objects"))
        return []
    texts = _texts(annotations)
    strays = sorted(path.name.strip() for path in annotations.iterdir() if path not in texts)
    if strays:
        findings.append(
            Finding(_short(annotations), f"it holds files of other programs ({', '.join(strays)})", "passed over")
        )
    parts = []
    for path in texts:
        rows, found = read_rows(path, _short(path))
        findings += found
        if not len(rows):
            findings.append(Finding(_short(path), "it is empty", "the object is left out"))
            continue
        parts.append((path, _label(path, findings), rows))
    columns = min((part.shape[1] for _, _, part in parts), default=0)
    return [(path, label, part[:, :columns]) for path, label, part in parts]


def _label(path: Path, findings: list[Finding]) -> str:
    """The label in an annotation's name, `chair` for `chair_12.txt`, misspelt ones put right."""
    written = re.sub(r"[_\s-]*\d*$", "", path.stem).lower()
    if written in LABELS:
        return written
    likely = get_close_matches(written, sorted(LABELS), n=1, cutoff=0.7)
    label = likely[0] if likely else "clutter"
    findings.append(Finding(_short(path), f"{written!r} is no label of S3DIS", f"taken for {label}"))
    return label


def _cloud(rows: NDArray[np.float64], folder: Path, findings: list[Finding]) -> PointCloud:
    if rows.shape[1] < 6:
        return PointCloud(rows[:, :3])
    colors = rows[:, 3:6]
    wrong = int(((colors < 0) | (colors > 255)).any(axis=1).sum())
    if wrong:
        findings.append(Finding(_short(folder), f"{wrong:,} points have colours outside 0 to 255", "clipped"))
    return PointCloud(rows[:, :3], (np.clip(colors, 0, 255) / 255).astype(np.float32))


def _texts(folder: Path) -> list[Path]:
    """The text files of a folder, sorted, without hidden ones (`.DS_Store`, `._chair_1.txt`)."""
    if not folder.is_dir():
        return []
    return sorted(
        path
        for path in folder.iterdir()
        if path.is_file() and path.suffix.lower() == ".txt" and not path.name.startswith(".")
    )


def _short(path: Path) -> str:
    """A path as people say it, from the area on: `Area_1/office_1/Annotations/chair_1.txt`."""
    parts = path.parts
    areas = [number for number, part in enumerate(parts) if part.lower().startswith("area_")]
    return "/".join(parts[areas[-1] :] if areas else parts[-2:])
