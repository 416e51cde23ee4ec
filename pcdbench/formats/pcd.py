"""PCD 0.7, ascii, binary and binary_compressed.

Read here and not by Open3D 0.20, which (tried) reads double coordinates as zeros and writes none. PCL's
packed `rgb` (8 bits each in the bits of a float) is read and written.
"""

from __future__ import annotations

import io
from collections.abc import Container, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats.columns import (
    NO_FIELDS,
    NOTHING,
    Columns,
    Fields,
    beyond_double,
    color_bytes,
    coordinate_and_color_names,
    flat_fields,
    needs_double,
    require_bytes,
    require_density,
    unit_colors,
)

_EXTENSION = ".pcd"
_PACKED = ("rgb", "rgba")
_KINDS = {"F": "f", "U": "u", "I": "i"}
# LZF's longest back reference gives 264 bytes for 3.
_MOST_COMPRESSED = 88


def read(path: Path, wanted: Container[str] = NOTHING) -> Columns:
    """The points of a PCD file; fields in any order and type, padding passed over.

    The VIEWPOINT is where the scanner stood; it is not applied to the points, as PCL does not.
    """
    row_type, rows = _rows(path)
    names = list(row_type.names or ())
    xyz, rgb = coordinate_and_color_names([name for name in names if row_type[name].shape == ()])
    if not xyz:
        raise CloudError(f"{path} has no fields x, y and z but {' '.join(names)}; export it as a point cloud")
    points = np.stack([rows[name].astype(np.float64) for name in xyz], axis=1)
    packed = next((name for name in _PACKED if name in names), None)
    taken = {*xyz, *rgb, *_PACKED}
    fields = {
        name: np.asarray(rows[name])
        for name in names
        if name in wanted and name not in taken and not name.startswith("_")
    }
    if packed == "rgba" and "alpha" in wanted and "alpha" not in fields:
        alpha = (np.ascontiguousarray(rows[packed]).view(np.uint32) >> 24).astype(np.uint8)
        # One value for all points says nothing: PCL writes 0 or 255 where nobody gave any.
        fields |= {"alpha": alpha} if np.ptp(alpha) else {}
    if packed:
        return Columns(points, unit_colors(_unpacked(rows[packed], path), path), fields)
    colors = np.stack([rows[name] for name in rgb], axis=1) if rgb else None
    return Columns(points, None if colors is None else unit_colors(colors, path), fields)


def _rows(path: Path) -> tuple[np.dtype[Any], Any]:
    """The type of a row, and the rows: an array of that type, or each column by its name."""
    with path.open("rb") as stream:
        header = _header(stream, path)
        row_type, count = _row_type(header, path)
        present = path.stat().st_size - stream.tell()
        match header["DATA"]:
            case ["ascii"]:
                require_bytes(path, 2 * count * _width(row_type) - 1, count, present)
                return row_type, _ascii_rows(stream, row_type, count, path)
            case ["binary"]:
                require_bytes(path, count * row_type.itemsize, count, present)
                return row_type, np.fromfile(stream, dtype=row_type, count=count)
            case ["binary_compressed"]:
                return row_type, _compressed_rows(stream, row_type, count, present, path)
            case other:
                raise CloudError(f"{path}: its data is {' '.join(other)!r}; save it as ascii or binary PCD")


def write(
    cloud: PointCloud, path: Path, fields: Fields = NO_FIELDS, exact: bool = False, like: Path | None = None
) -> None:
    """Write binary PCD: x y z as float, or as double where float would lose more than 0.05 mm; packed `rgb`.

    Fields follow. Where it must be exact, coordinates are double if float would lose anything. The VIEWPOINT is that
    of `like`.
    """
    size = 8 if needs_double(cloud.points, exact) else 4
    columns = dict.fromkeys("xyz", ("F", size))
    kinds = [(name, f"<f{size}") for name in "xyz"]
    if cloud.colors is not None:
        columns["rgb"] = ("F", 4)
        # By PCL's custom a float in the header, whose bits are the colour.
        kinds.append(("rgb", "<u4"))
    others = flat_fields(fields)
    for name, field in others.items():
        columns[name] = (field.dtype.kind.upper(), field.dtype.itemsize)
        kinds.append((name, field.dtype.str))
    rows = np.empty(len(cloud), dtype=kinds)
    for name, column in zip("xyz", cloud.points.T, strict=True):
        rows[name] = column
    if cloud.colors is not None:
        red, green, blue = color_bytes(cloud.colors).astype(np.uint32).T
        rows["rgb"] = red << 16 | green << 8 | blue
    for name, field in others.items():
        rows[name] = field
    header = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        "FIELDS " + " ".join(columns),
        "SIZE " + " ".join(str(size) for _, size in columns.values()),
        "TYPE " + " ".join(kind for kind, _ in columns.values()),
        "COUNT " + " ".join("1" * len(columns)),
        f"WIDTH {len(cloud)}",
        "HEIGHT 1",
        f"VIEWPOINT {_viewpoint(like)}",
        f"POINTS {len(cloud)}",
        "DATA binary\n",
    ]
    with path.open("wb") as stream:
        stream.write("\n".join(header).encode())
        stream.write(rows.data)


def _viewpoint(path: Path | None) -> str:
    """Where the scanner of a PCD file stood (x y z) and how it was turned (w x y z), as the file spells it."""
    if path is not None and path.suffix.lower() == _EXTENSION:
        with path.open("rb") as stream:
            words = _header(stream, path).get("VIEWPOINT", [])
        with suppress(ValueError):
            if len([float(word) for word in words]) == 7:
                return " ".join(words)
    return "0 0 0 1 0 0 0"


def _header(stream: BinaryIO, path: Path) -> dict[str, list[str]]:
    """The header's words by their key; the stream then stands behind the DATA line."""
    header: dict[str, list[str]] = {}
    for _ in range(64):
        words = stream.readline(1 << 16).decode("ascii", errors="replace").split()
        if not words or words[0].startswith("#"):
            continue
        header[words[0].upper()] = words[1:]
        if words[0].upper() == "DATA":
            return header
    raise CloudError(f"{path} is not a PCD file, or cut off within its header; check its extension or copy it again")


def _row_type(header: dict[str, list[str]], path: Path) -> tuple[np.dtype[Any], int]:
    """The type of a row, and the number of rows."""
    fields = header.get("FIELDS") or header.get("COLUMNS") or []
    counts = header.get("COUNT") or ["1"] * len(fields)
    try:
        number = header["POINTS"] if "POINTS" in header else header["WIDTH"]
        height = 1 if "POINTS" in header else int(header.get("HEIGHT", ["1"])[0])
        columns: list[tuple[Any, ...]] = []
        for place, (name, size, kind, count) in enumerate(
            zip(fields, header["SIZE"], header["TYPE"], counts, strict=True)
        ):
            # PCL fills rows up with fields named _, several of them.
            name = name if name != "_" and name not in fields[:place] else f"_{place}"
            columns.append((name, f"<{_KINDS[kind.upper()]}{int(size)}", *([(int(count),)] if int(count) != 1 else [])))
        points = int(number[0]) * height
        if points < 0 or not columns:
            raise ValueError("no points or no fields")
        return np.dtype(columns), points
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise CloudError(f"{path}: its header's FIELDS, SIZE, TYPE, COUNT and POINTS do not fit together") from error


def _width(row_type: np.dtype[Any]) -> int:
    """Numbers in a row."""
    return sum(int(np.prod(row_type[name].shape)) for name in row_type.names or ())


def _ascii_rows(stream: BinaryIO, row_type: np.dtype[Any], count: int, path: Path) -> dict[str, NDArray[Any]]:
    if not count:
        return {name: np.empty(0) for name in row_type.names or ()}
    first = stream.tell()
    numbers = _ascii_numbers(stream, count, np.dtype(np.float64))
    if len(numbers) < count or numbers.shape[1] != _width(row_type):
        raise CloudError(
            f"{path} is cut off: its header promises {count:,} points of {_width(row_type)} numbers, "
            f"{len(numbers):,} of {numbers.shape[1]} are there; copy it again"
        )
    rows, start = {}, 0
    for name in row_type.names or ():
        width = int(np.prod(row_type[name].shape))
        column, base = numbers[:, start : start + width].reshape(-1, *row_type[name].shape), row_type[name].base
        if base.kind in "iu" and not np.all((column >= np.iinfo(base).min) & (column <= np.iinfo(base).max)):
            raise CloudError(f"{path}: field {name} does not fit the type its header names; export it again")
        # Coordinates stay double: text may hold more digits than the named type.
        is_coordinate = name in ("x", "y", "z")
        if base.kind in "iu" and not is_coordinate and beyond_double(column):
            # Fails where they are written with a point or an exponent: then they stay floating-point numbers. NumPy
            # 1.26 warns instead and cuts them off, which shows when they are compared.
            with suppress(ValueError, DeprecationWarning):
                stream.seek(first)
                whole = _ascii_numbers(stream, count, base, range(start, start + width)).reshape(column.shape)
                column = whole if np.array_equal(whole.astype(np.float64), column) else column
        rows[name] = column if is_coordinate else column.astype(base)
        start += width
    return rows


def _ascii_numbers(
    stream: BinaryIO, count: int, kind: np.dtype[Any], places: Sequence[int] | None = None
) -> NDArray[Any]:
    """(at most count, len(places)) these columns, or all, of the rows from here on."""
    lines = io.TextIOWrapper(stream, encoding="ascii", errors="replace")
    try:
        rows = (line for line in lines if line.strip())
        return np.loadtxt(rows, dtype=kind, max_rows=count, usecols=places, ndmin=2, comments=None)
    finally:
        # The stream stays open.
        lines.detach()


def _compressed_rows(
    stream: BinaryIO, row_type: np.dtype[Any], count: int, present: int, path: Path
) -> dict[str, NDArray[Any]]:
    """Rows that were stored field by field, then packed by LZF."""
    sizes = stream.read(8)
    if len(sizes) < 8:
        raise CloudError(f"{path} is cut off behind its header; copy it again")
    packed_size, size = map(int, np.frombuffer(sizes, "<u4"))
    require_bytes(path, packed_size, count, present - 8)
    if size != count * row_type.itemsize or size > _MOST_COMPRESSED * packed_size:
        raise CloudError(f"{path}: its compressed data do not fit its header; export it again")
    require_density(path, count)
    data = _lzf_unpacked(stream.read(packed_size), size, path)
    rows, start = {}, 0
    for name in row_type.names or ():
        kind = row_type[name]
        rows[name] = np.frombuffer(data, kind, count, offset=start)
        start += count * kind.itemsize
    return rows


def _lzf_unpacked(packed: bytes, size: int, path: Path) -> bytes:
    """LZF (Lehmann's liblzf): literal runs, and references to what was already written."""
    out = bytearray()
    at = 0
    try:
        while at < len(packed):
            control = packed[at]
            at += 1
            if control < 32:
                out += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += packed[at]
                at += 1
            start = len(out) - ((control & 31) << 8) - packed[at] - 1
            at += 1
            length += 2
            if start < 0:
                raise IndexError
            # A reference may run into what it is writing: then it repeats.
            piece = out[start : start + length]
            out += (piece * (length // len(piece) + 1))[:length]
    except IndexError:
        raise CloudError(f"{path}: its compressed data are damaged; copy or export it again") from None
    if len(out) != size:
        raise CloudError(f"{path}: its compressed data are cut off or damaged; copy or export it again")
    return bytes(out)


def _unpacked(packed: NDArray[Any], path: Path) -> NDArray[np.uint8]:
    """(N, 3) 8-bit colours from packed ones: the bits of a 32-bit field, whatever number they spell."""
    if packed.dtype.itemsize != 4 or packed.ndim != 1:
        raise CloudError(f"{path}: its field rgb must have 32 bits; export it again")
    bits = np.ascontiguousarray(packed).view(np.uint32)
    return np.stack([bits >> 16 & 255, bits >> 8 & 255, bits & 255], axis=1).astype(np.uint8)
