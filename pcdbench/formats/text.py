"""Text: one point a line, separated by blanks, tabs, commas or semicolons, with or without a header."""

from __future__ import annotations

import codecs
import re
import warnings
from collections.abc import Container, Iterator
from contextlib import suppress
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
    NOTHING,
    CloudWarning,
    Columns,
    Fields,
    beyond_double,
    color_bytes,
    coordinate_and_color_names,
    flat_fields,
    unit_colors,
    unit_of,
)

_COMMENT = re.compile(r"\s*(#|//)\s*")
_DECIMAL_COMMA = re.compile(r"\s*-?\d+,\d+\s*[;\t ]\s*-?\d+,\d+")
_QUOTED = re.compile(r'"[^"]*"')
_RGB = ("red", "green", "blue")
_HEADER_LINES = 200
_LONGEST_COUNT = 20
_ROWS_A_PIECE = 100_000


@dataclass(frozen=True)
class _Layout:
    separator: str | None  # None: blanks and tabs
    lines_before: int
    header: list[str]  # words of the line above the rows, [] where there is none
    names: list[str]  # of the columns; [] where the file does not say
    columns: int
    promised: int | None  # points, where a first line has their number


def read(path: Path, wanted: Container[str] = NOTHING) -> Columns:
    """The points of a text file.

    Columns are found by their names where a header line (or the comment before the first row) has x, y and z, otherwise
    by place, with a warning where a header has other names, or not one for each column: x y z, then, in files of six
    columns and more, red green blue. Three columns of unit vectors in that place are normals. Of seven columns the
    fourth is an intensity where it cannot be a colour, or where the first line is a number of points, as in PTS files.
    Fields without a name have that of their place (`column_7`).
    """
    layout = _layout(path)
    if layout.columns < 3:
        raise CloudError(f"{path} has {layout.columns} columns where x y z are needed; check its separators")
    xyz, rgb = coordinate_and_color_names(layout.names)
    if xyz:
        if unit_of(xyz[0]) not in ("", "m"):
            told = f"{path}: its header gives x in {unit_of(xyz[0])}; coordinates are taken as metres, so convert them"
            warnings.warn(told, CloudWarning, 4)
        others = [name for name in layout.names if name in wanted and name not in xyz + rgb]
        numbers, others = _with_others(path, layout, xyz + rgb, others)
        names = xyz + rgb + others
        places = [layout.names.index(name) for name in names]
    else:
        if layout.header:
            # Not refused: coordinates have names in every language, and most files begin with them.
            wrong = "names no x, y and z"
            if not layout.names:
                wrong = f"has {len(layout.header)} names for {layout.columns} columns"
            warnings.warn(
                f"{path}: its header ({', '.join(layout.header)[:80]}) {wrong}; the first three are taken for x, y and "
                "z. If they are others, name them so in a first line that has one name for each column",
                CloudWarning,
                4,
            )
        own = 3 if layout.columns < 6 else 7 if layout.columns == 7 else 6
        more = [place for place in range(own, layout.columns) if f"column_{place + 1}" in wanted]
        places = [*range(own), *more]
        numbers = _numbers(path, layout, places)
        names = _names_by_place(numbers, places, layout, path)
        xyz, rgb = coordinate_and_color_names(names)
    column = dict(zip(names, numbers.T, strict=True))
    promised = _promised(path) if _has_counts(path, layout) else 0
    if len(numbers) < promised:
        raise CloudError(f"{path} is cut off: {len(numbers):,} of {promised:,} points are there; copy it again")
    fields = {name: column[name] for name in column if name in wanted and name not in xyz + rgb}
    for name in [name for name in fields if beyond_double(fields[name])]:
        for kind in (np.int64, np.uint64):
            # Fails where they are written with a point or an exponent: then they stay floating-point numbers. NumPy
            # 1.26 warns instead and cuts them off, which shows when they are compared.
            with suppress(ValueError, DeprecationWarning):
                whole = _read(path, layout, [places[names.index(name)]], np.dtype(kind))[:, 0]
                if np.array_equal(whole.astype(np.float64), fields[name]):
                    fields[name] = whole
                    break
    colors = None
    if rgb:
        first = None if layout.names and set(rgb) <= set(layout.names) else names.index(rgb[0])
        colors = _colors(np.stack([column[name] for name in rgb], axis=1), first, layout, path)
    return Columns(np.stack([column[name] for name in xyz], axis=1), colors, fields)


def _colors(numbers: NDArray[np.float64], first: int | None, layout: _Layout, path: Path) -> NDArray[np.float32]:
    """(N, 3) colours of these columns; `first` is the place of red where no name says that it is red."""
    try:
        return unit_colors(numbers, path)
    except CloudError as error:
        if first is None:
            raise
        raise CloudError(
            f"{error}; or, if columns {first + 1} to {first + 3} are no colours, write a first line that names all "
            f"{layout.columns} (x y z intensity ...)"
        ) from error


def _names_by_place(numbers: NDArray[np.float64], places: list[int], layout: _Layout, path: Path) -> list[str]:
    """What the columns at these places are of a file that does not name them."""
    names = ["x", "y", "z", *(f"column_{place + 1}" for place in places[3:])]
    if numbers.shape[1] < 6:
        return names
    if _are_unit_vectors(numbers[:, 3:6]):
        return [*names[:3], "nx", "ny", "nz", *names[6:]]
    if layout.columns == 7 and _may_be_bytes(numbers[:, 4:7]):
        if layout.promised is not None or not _may_be_bytes(numbers[:, 3]):
            return [*names[:3], "intensity", *_RGB]
        warnings.warn(
            f"{path}: its seven columns have no names; the 4th to 6th are taken for red, green and blue. If the 4th is "
            "an intensity, write a first line: x y z intensity red green blue",
            CloudWarning,
            4,
        )
    return [*names[:3], *_RGB, *names[6:]]


def _may_be_bytes(numbers: NDArray[np.float64]) -> bool:
    return bool(np.all((numbers >= 0) & (numbers <= 255) & (numbers == np.floor(numbers)) | np.isnan(numbers)))


def _with_others(
    path: Path, layout: _Layout, needed: list[str], others: list[str]
) -> tuple[NDArray[np.float64], list[str]]:
    """The needed columns of all rows with those of the others that hold numbers in every row, and which these are."""
    places = [layout.names.index(name) for name in needed]
    try:
        return _numbers(path, layout, places + [layout.names.index(name) for name in others]), others
    except CloudError:
        columns, kept = [_numbers(path, layout, places)], []
        for name in others:
            with suppress(CloudError):
                columns.append(_numbers(path, layout, [layout.names.index(name)]))
                kept.append(name)
        lost = ", ".join(name for name in others if name not in kept)
        warnings.warn(f"{path}: {lost}: not a number in every row, left out", CloudWarning, 5)
        return np.concatenate(columns, axis=1), kept


def _numbers(path: Path, layout: _Layout, places: list[int]) -> NDArray[np.float64]:
    """(N, len(places)) these columns of all rows."""
    try:
        return _read(path, layout, places, np.dtype(np.float64))
    except ValueError as error:
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            for number, line in enumerate(stream, 1):
                words = [word.strip('" \t') for word in line.split("#")[0].strip().split(layout.separator)]
                asked = [words[place] for place in places if place < len(words)]
                is_count = _has_counts(path, layout) and line.strip().isdecimal()
                is_row = number > layout.lines_before and any(words) and not is_count
                if is_row and not (len(asked) == len(places) and all(map(_is_number, asked))):
                    raise CloudError(
                        f"{path}: line {number} ({line.strip()[:60]!r}) has no {layout.columns} numbers as the first "
                        "row has; mend or delete it"
                    ) from error
        raise


def _read(path: Path, layout: _Layout, places: list[int], kind: np.dtype[Any]) -> NDArray[Any]:
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        lines: Iterator[str] = islice(stream, layout.lines_before, None)
        if _has_counts(path, layout):
            lines = (line for line in lines if not line.strip().isdecimal())
        # A label with a single quote must not swallow the lines down to the next one.
        rows = (line.replace('"', "") if line.count('"') % 2 else line for line in lines)
        return np.loadtxt(rows, dtype=kind, delimiter=layout.separator, usecols=places, ndmin=2, quotechar='"')


def _has_counts(path: Path, layout: _Layout) -> bool:
    """Whether each scan in the file begins with the number of its points."""
    return path.suffix.lower() == ".pts" and layout.promised is not None


def _promised(path: Path) -> int:
    """The sum of these numbers."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        return sum(int(line) for line in stream if len(line) < _LONGEST_COUNT and line.strip().isdecimal())


def holds_points(path: Path) -> bool:
    """Whether the first rows of a text file look like points; notes and tables do not."""
    try:
        return path.is_file() and _layout(path, with_words=False).columns >= 3
    except (CloudError, OSError):
        return False


def write(
    cloud: PointCloud, path: Path, fields: Fields = NO_FIELDS, exact: bool = False, like: Path | None = None
) -> None:
    """Write x y z with 0.01 mm (a nanometre where it must be exact) and 8-bit colours.

    CSV with commas and a header line, all others with blanks; these have a comment that names the columns only
    where there are fields, and PTS files begin with the number of points.
    """
    is_csv = path.suffix.lower() == ".csv"
    separator = "," if is_csv else " "
    names, formats = ["x", "y", "z"], ["%.9f" if exact else "%.5f"] * 3
    columns: list[NDArray[Any]] = [cloud.points]
    if cloud.colors is not None:
        names += ["red", "green", "blue"]
        formats += ["%d"] * 3
        columns.append(color_bytes(cloud.colors))
    for name, field in flat_fields(fields).items():
        names.append(name)
        formats.append("%d" if field.dtype.kind in "iu" else "%.9g" if field.dtype == np.float32 else "%.17g")
        columns.append(field)
    with path.open("w", encoding="ascii") as stream:
        if path.suffix.lower() == ".pts":
            stream.write(f"{len(cloud)}\n")
        if is_csv or fields:
            stream.write(f"{'' if is_csv else '# '}{separator.join(names)}\n")
        line = separator.join(formats) + "\n"
        # In pieces: all columns as Python's numbers at once would take many times the memory of the cloud.
        for start in range(0, len(cloud), _ROWS_A_PIECE):
            parts = [column[start : start + _ROWS_A_PIECE].T for column in columns]
            rows = zip(*(numbers.tolist() for part in parts for numbers in np.atleast_2d(part)), strict=True)
            stream.writelines(line % row for row in rows)


def _layout(path: Path, with_words: bool = True) -> _Layout:
    """How the file is laid out, from its first lines.

    Args:
        with_words: rows may hold words (labels) beside the coordinates and colours that a header names.
    """
    with path.open("rb") as stream:
        start = stream.read(4096)
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise CloudError(f"{path} is text in UTF-16; save it as UTF-8")
    if b"\0" in start:
        raise CloudError(f"{path} is not text; check its extension")
    promised = None
    names: list[str] = []
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        lines = [stream.readline(1 << 16) for _ in range(_HEADER_LINES)]
    for number, line in enumerate(lines):
        text = _COMMENT.sub("", line, count=1).strip() if _COMMENT.match(line) else line.split("#")[0].strip()
        # Within quotes they separate nothing.
        text = _QUOTED.sub(lambda quoted: re.sub(r"[;,\t]", " ", quoted[0]), text)
        separator = next((mark for mark in ";,\t" if mark in text), None)
        words = [word.strip("\"' \t") for word in text.split(separator)]
        if separator and not words[-1] and len(words) != len(names):
            words.pop()  # some programs end each line with a separator
        if _COMMENT.match(line):
            names = words if coordinate_and_color_names(words)[0] else names
        elif words and (all(map(_is_number, words)) or (with_words and _has_named_numbers(words, names, separator))):
            # Some programs write the number of points before the first of them.
            if len(words) > 1 or not words[0].isdecimal():
                is_named = len(names) == len(words) or _has_named_numbers(words, names, separator)
                columns = len(names) if is_named else len(words)
                return _Layout(separator, number, names, _told_apart(names) if is_named else [], columns, promised)
            promised = int(words[0]) if len(words[0]) < 16 else None
        elif text and not names:
            names = words
        elif text:
            break
    if any(_DECIMAL_COMMA.match(line) for line in lines):
        raise CloudError(f"{path} has decimal commas; save it with decimal points")
    raise CloudError(
        f"{path} has no rows of numbers; each line must hold x y z, and may hold red green blue; where it holds text, "
        "too, the first line must name the columns"
    )


def _told_apart(names: list[str]) -> list[str]:
    """Names of which no two are the same: the first keeps its own."""
    taken: set[str] = set()
    unique = []
    for name in names:
        number, found = 1, name or "field"
        while found in taken:
            number += 1
            found = f"{name or 'field'}_{number}"
        taken.add(found)
        unique.append(found)
    return unique


def _has_named_numbers(words: list[str], names: list[str], separator: str | None) -> bool:
    """Whether a row has numbers where its header names x, y, z, red, green and blue, whatever the rest of it is.

    Empty cells may be missing at its end, but between blanks, where nothing tells which are.
    """
    if len(names) < len(words) or (separator is None and len(names) > len(words)):
        return False
    xyz, rgb = coordinate_and_color_names(names)
    places = [names.index(name) for name in xyz + rgb]
    return bool(xyz) and max(places) < len(words) and all(_is_number(words[place]) for place in places)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _are_unit_vectors(vectors: np.ndarray) -> bool:
    # Where no normal could be estimated many programs write NaN.
    vectors = vectors[np.isfinite(vectors).all(axis=1)]
    lengths = np.linalg.norm(vectors, axis=1)
    return bool(vectors.size and vectors.min() < 0 and np.median(np.abs(lengths - 1)) < 0.01)
