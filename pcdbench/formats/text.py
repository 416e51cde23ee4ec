"""Text: one point a line, separated by blanks, tabs, commas or semicolons, with or without a header."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats.columns import (
    NO_FIELDS,
    Columns,
    Fields,
    color_bytes,
    coordinate_and_color_names,
    unit_colors,
    whole_bytes,
)

_COMMENT = re.compile(r"\s*(#|//)\s*")
_HEADER_LINES = 200
_ROWS_A_PIECE = 100_000


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


def read_fields(path: Path) -> dict[str, NDArray[Any]]:
    """The named columns besides coordinates and colours; without names there are none."""
    layout = _layout(path)
    xyz, rgb = coordinate_and_color_names(layout.names)
    places = {name: place for place, name in enumerate(layout.names) if name not in xyz + rgb}
    if not xyz or not places:
        return {}
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        numbers = np.loadtxt(
            islice(stream, layout.lines_before, None),
            delimiter=layout.separator,
            usecols=list(places.values()),
            ndmin=2,
        )
    return dict(zip(places, numbers.T, strict=True))


def write(cloud: PointCloud, path: Path, fields: Fields = NO_FIELDS, exact: bool = False) -> None:
    """Write x y z with 0.01 mm (a nanometre where it must be exact) and 8-bit colours.

    CSV with commas and a header line, all others with blanks; these have a comment that names the columns only
    where there are fields.
    """
    is_csv = path.suffix.lower() == ".csv"
    separator = "," if is_csv else " "
    names, formats = ["x", "y", "z"], ["%.9f" if exact else "%.5f"] * 3
    columns: list[NDArray[Any]] = [cloud.points]
    if cloud.colors is not None:
        names += ["red", "green", "blue"]
        formats += ["%d"] * 3
        columns.append(color_bytes(cloud.colors))
    for name, field in fields.items():
        names.append(name)
        formats.append("%d" if whole_bytes(field) else "%.4f")
        columns.append(field)
    with path.open("w", encoding="ascii") as stream:
        if is_csv or fields:
            stream.write(f"{'' if is_csv else '# '}{separator.join(names)}\n")
        # In pieces: all columns as doubles at once would take as much memory again as the cloud.
        for start in range(0, len(cloud), _ROWS_A_PIECE):
            piece = np.column_stack([column[start : start + _ROWS_A_PIECE] for column in columns])
            np.savetxt(stream, piece, fmt=formats, delimiter=separator)


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
