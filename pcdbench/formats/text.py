"""Text: one point a line, separated by blanks, tabs, commas or semicolons, with or without a header."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats.columns import Columns, color_bytes, coordinate_and_color_names, unit_colors

_COMMENT = re.compile(r"\s*(#|//)\s*")
_HEADER_LINES = 200


@dataclass(frozen=True)
class _Layout:
    separator: str | None  # None: blanks and tabs
    lines_before: int
    names: list[str]  # of the columns; [] where the file does not say
    columns: int


def read(path: Path) -> Columns:
    """The points of a text file.

    Columns are found by their names where a header line (or the comment before the first row) has x, y and z,
    otherwise by place: x y z, then, in files of six columns and more, red green blue. Three columns of unit
    vectors in that place are normals and passed over.
    """
    layout = _layout(path)
    xyz_names, rgb_names = coordinate_and_color_names(layout.names)
    if xyz_names:
        places = [layout.names.index(name) for name in xyz_names + rgb_names]
    else:
        places = list(range(6 if layout.columns >= 6 else 3))
    if max(places) >= layout.columns:
        raise CloudError(f"{path} has {layout.columns} columns where x y z are needed; check its separators")
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        numbers = np.loadtxt(
            islice(stream, layout.lines_before, None), delimiter=layout.separator, usecols=places, ndmin=2
        )
    points, colors = numbers[:, :3], numbers[:, 3:]
    if not colors.size or (not rgb_names and _are_unit_vectors(colors)):
        return Columns(points, None)
    return Columns(points, unit_colors(colors, path))


def holds_points(path: Path) -> bool:
    """Whether the first rows of a text file look like points; notes and tables do not."""
    try:
        return _layout(path).columns >= 3
    except (CloudError, OSError):
        return False


def write(cloud: PointCloud, path: Path) -> None:
    """Write x y z with 0.01 mm and 8-bit colours; CSV with commas and a header line, all others with blanks."""
    is_csv = path.suffix.lower() == ".csv"
    names = ["x", "y", "z"] if cloud.colors is None else ["x", "y", "z", "red", "green", "blue"]
    numbers = cloud.points if cloud.colors is None else np.hstack([cloud.points, color_bytes(cloud.colors)])
    np.savetxt(
        path,
        numbers,
        fmt=["%.5f"] * 3 + ["%d"] * (len(names) - 3),
        delimiter="," if is_csv else " ",
        header=",".join(names) if is_csv else "",
        comments="",
    )


def _layout(path: Path) -> _Layout:
    """How the file is laid out, from its first lines."""
    with path.open("rb") as stream:
        if b"\0" in stream.read(4096):
            raise CloudError(f"{path} is not text; check its extension")
    names: list[str] = []
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        lines = [stream.readline(1 << 16) for _ in range(_HEADER_LINES)]
    for number, line in enumerate(lines):
        text = _COMMENT.sub("", line, count=1).strip() if _COMMENT.match(line) else line.split("#")[0].strip()
        separator = next((mark for mark in ";," if mark in text), None)
        words = [word.strip() for word in text.split(separator)]
        if _COMMENT.match(line):
            names = words if coordinate_and_color_names(words)[0] else names
        elif words and all(map(_is_number, words)):
            # Some programs write the number of points before the first of them.
            if len(words) > 1 or not words[0].isdecimal():
                return _Layout(separator, number, names if len(names) == len(words) else [], len(words))
        elif text and not names:
            names = words
        elif text:
            break
    raise CloudError(f"{path} has no rows of numbers; each line must hold x y z, and may hold red green blue")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _are_unit_vectors(vectors: np.ndarray) -> bool:
    lengths = np.linalg.norm(vectors, axis=1)
    return bool(vectors.min() < 0 and np.median(np.abs(lengths - 1)) < 0.01)
