"""PLY, ascii and binary, of either byte order.

Read here and not by Open3D 0.20, which (tried) returns a file cut off after 2 of 2,000 points as 2,000 points,
16-bit colours as 257 instead of 1, and dies of a header that promises 2 * 10^9 points.
"""

from __future__ import annotations

import io
from collections.abc import Container, Iterator
from dataclasses import dataclass, field
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
    unit_colors,
)

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_NAMES = {kind: name for name, kind in reversed(_TYPES.items())}  # the older ones, which all programs know
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 1 << 20


@dataclass
class _Property:
    name: str
    type: str
    count_type: str | None = None  # of a list


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def has_list(self) -> bool:
        return any(item.count_type for item in self.properties)

    def row_type(self, byte_order: str) -> np.dtype[Any]:
        """One row without its lists."""
        return np.dtype([(item.name, byte_order + item.type) for item in self.properties if not item.count_type])

    def smallest_row(self) -> int:
        """Bytes of a binary row whose lists are empty."""
        return sum(np.dtype(item.count_type or item.type).itemsize for item in self.properties)


def read(path: Path, wanted: Container[str] = NOTHING) -> Columns:
    """The element `vertex` of a PLY file: properties of any type and order; lists are passed over."""
    xyz, rgb, rows = _vertices(path, wanted)
    points = np.stack([rows[name].astype(np.float64) for name in xyz], axis=1)
    colors = np.stack([rows[name] for name in rgb], axis=1) if rgb else None
    names = rows if isinstance(rows, dict) else rows.dtype.names or ()
    fields = {name: np.asarray(rows[name]) for name in names if name not in xyz + rgb and name in wanted}
    return Columns(points, None if colors is None else unit_colors(colors, path), fields)


def _vertices(
    path: Path, wanted: Container[str]
) -> tuple[list[str], list[str], NDArray[Any] | dict[str, NDArray[Any]]]:
    """The names of x, y, z and of red, green, blue, and the vertices' rows; of text only these and what is wanted."""
    with path.open("rb") as stream:
        byte_order, elements = _header(stream, path)
        elements_named = [element.name for element in elements]
        if "vertex" not in elements_named:
            raise CloudError(f"{path} has no element vertex; export it as a point cloud")
        position = elements_named.index("vertex")
        vertex = elements[position]
        names = [item.name for item in vertex.properties if not item.count_type]
        xyz, rgb = coordinate_and_color_names(names)
        if not xyz:
            raise CloudError(f"{path}: its vertices have no x, y and z; export it as a point cloud")
        present = path.stat().st_size - stream.tell()
        if byte_order:
            require_bytes(path, vertex.count * vertex.smallest_row(), vertex.count, present)
            return xyz, rgb, _binary_rows(stream, elements[:position], vertex, byte_order, path)
        require_bytes(path, 2 * vertex.count * len(vertex.properties) - 1, vertex.count, present)
        asked = [name for name in names if name in xyz + rgb or name in wanted]
        return xyz, rgb, _ascii_rows(stream, elements[:position], vertex, asked, path)


def write(
    cloud: PointCloud, path: Path, fields: Fields = NO_FIELDS, exact: bool = False, like: Path | None = None
) -> str | None:
    """Write binary PLY: x y z as float, or as double where float would lose more than 0.05 mm; 8-bit colours.

    Fields follow. Where it must be exact, coordinates are double if float would lose anything.

    Returns:
        Which fields lost digits, to be told.
    """
    columns: dict[str, NDArray[Any]] = dict(zip("xyz", cloud.points.T, strict=True))
    kinds = dict.fromkeys("xyz", np.dtype("<f8" if needs_double(cloud.points, exact) else "<f4"))
    others = flat_fields(fields)
    lossy = [name for name, column in others.items() if column.dtype.kind in "iu" and beyond_double(column)]
    others = {name: _storable(column) for name, column in others.items()}
    if cloud.colors is not None:
        others = dict(zip(("red", "green", "blue"), color_bytes(cloud.colors).T, strict=True)) | others
    columns |= others
    kinds |= {name: column.dtype for name, column in others.items()}
    rows = np.empty(len(cloud), dtype=list(kinds.items()))
    for name, column in columns.items():
        rows[name] = column
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    header += [f"property {_NAMES[kind.str[1:]]} {name}" for name, kind in kinds.items()]
    with path.open("wb") as stream:
        stream.write("\n".join([*header, "end_header\n"]).encode())
        stream.write(rows.data)
    if not lossy:
        return None
    return f"PLY has no whole numbers as large as those of {', '.join(lossy)}, which lose digits; write NPZ"


def _storable(column: NDArray[Any]) -> NDArray[Any]:
    """PLY has no numbers of 64 bits but double."""
    if column.dtype.kind not in "iu" or column.dtype.itemsize < 8:
        return column
    smaller = np.dtype("<i4" if column.dtype.kind == "i" else "<u4")
    fits = not column.size or (column.min() >= np.iinfo(smaller).min and column.max() <= np.iinfo(smaller).max)
    return column.astype(smaller if fits else "<f8")


def _header(stream: BinaryIO, path: Path) -> tuple[str, list[_Element]]:
    """The byte order ("" for ascii) and the elements; the stream then stands at the first row."""
    if stream.readline(10).strip() != b"ply":
        raise CloudError(f"{path} is not a PLY file (it does not begin with 'ply'); check its extension")
    byte_order: str | None = None
    elements: list[_Element] = []
    while stream.tell() < _LONGEST_HEADER:
        line = stream.readline(_LONGEST_HEADER)
        words = line.decode("ascii", errors="replace").split()
        match words:
            case ["end_header"]:
                if byte_order is None:
                    raise CloudError(f"{path}: its header names no format; export it again")
                return byte_order, elements
            case ["format", name, _] if name in _BYTE_ORDERS:
                byte_order = _BYTE_ORDERS[name]
            case ["element", name, count] if count.isdecimal() and len(count) < 16:
                elements.append(_Element(name, int(count)))
            case ["property", "list", count_type, kind, name] if elements and {count_type, kind} <= _TYPES.keys():
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[count_type]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind]))
            case ["comment" | "obj_info", *_]:
                pass
            case []:
                if not line:
                    break
            case _:
                raise CloudError(f"{path}: its header line {' '.join(words)[:60]!r} is not PLY; export it again")
    raise CloudError(f"{path} is cut off within its header; copy it again")


def _ascii_rows(
    stream: BinaryIO, before: list[_Element], vertex: _Element, wanted: list[str], path: Path
) -> dict[str, NDArray[Any]]:
    lines = io.TextIOWrapper(stream, encoding="ascii", errors="replace")
    # One row a line; empty lines are none.
    passed, skipped = 0, sum(element.count for element in before)
    while passed < skipped:
        line = lines.readline()
        if not line:
            raise CloudError(f"{path} is cut off before its vertices; copy it again")
        passed += bool(line.strip())
    names = [item.name for item in vertex.properties if not item.count_type]
    if not vertex.count:
        return {name: np.empty(0) for name in wanted}
    rows_of_text = (line for line in lines if line.strip())
    numbers = np.loadtxt(
        _without_lists(rows_of_text, vertex, path) if vertex.has_list else rows_of_text,
        max_rows=vertex.count,
        usecols=[names.index(name) for name in wanted],
        ndmin=2,
        comments=None,
    )
    lines.detach()
    if len(numbers) < vertex.count:
        raise CloudError(
            f"{path} is cut off: its header promises {vertex.count:,} points, {len(numbers):,} are there; copy it again"
        )
    rows = {}
    xyz, _ = coordinate_and_color_names(names)
    for name, column in zip(wanted, numbers.T, strict=True):
        kind = np.dtype(next(item.type for item in vertex.properties if item.name == name))
        if kind.kind in "iu":
            limits = np.iinfo(kind)
            if not np.all((column >= limits.min) & (column <= limits.max)):
                raise CloudError(f"{path}: {name} does not fit the type its header names; export it again")
        rows[name] = column if name in xyz else column.astype(kind)
    return rows


def _without_lists(lines: Iterator[str], element: _Element, path: Path) -> Iterator[str]:
    """The lines of an element's rows, the words of its lists left out."""
    for line in lines:
        words = line.split()
        kept, at = [], 0
        for item in element.properties:
            if item.count_type:
                length = words[at] if at < len(words) else ""
                if not length.isdecimal():
                    raise CloudError(f"{path}: a list of {element.name} does not say how long it is; export it again")
                at += 1 + int(length)
            else:
                kept += words[at : at + 1]
                at += 1
        yield " ".join(kept)


def _binary_rows(
    stream: BinaryIO, before: list[_Element], vertex: _Element, byte_order: str, path: Path
) -> NDArray[Any] | dict[str, NDArray[Any]]:
    for element in before:
        if element.has_list:
            _rows_with_lists(stream, element, byte_order, path)
        else:
            stream.seek(element.count * element.smallest_row(), io.SEEK_CUR)
    if vertex.has_list:
        return _rows_with_lists(stream, vertex, byte_order, path)
    row_type = vertex.row_type(byte_order)
    present = path.stat().st_size - stream.tell()
    require_bytes(path, vertex.count * row_type.itemsize, vertex.count, present)
    return np.fromfile(stream, dtype=row_type, count=vertex.count)


def _rows_with_lists(stream: BinaryIO, element: _Element, byte_order: str, path: Path) -> NDArray[Any]:
    """The rows of an element without its lists, one after the other, as their lengths differ."""
    row_type = element.row_type(byte_order)
    plan = []
    for item in element.properties:
        count_type = np.dtype(byte_order + item.count_type) if item.count_type else None
        plan.append((np.dtype(byte_order + item.type), count_type))
    rows = bytearray()
    for _ in range(element.count):
        for kind, count_type in plan:
            if count_type:
                length = int(np.frombuffer(_exactly(stream, count_type.itemsize, path), count_type)[0])
                if length < 0:
                    raise CloudError(f"{path}: a list of {element.name} has a negative length; export it again")
                _exactly(stream, length * kind.itemsize, path)
            else:
                rows += _exactly(stream, kind.itemsize, path)
    # Nothing but lists leaves nothing to read.
    return np.frombuffer(bytes(rows), row_type) if row_type.itemsize else np.empty(element.count, row_type)


def _exactly(stream: BinaryIO, count: int, path: Path) -> bytes:
    # Asked for in pieces: the count may be nonsense, and a read allocates before it reads.
    if count > 1 << 20:
        require_bytes(path, stream.tell() + count, 0, path.stat().st_size)
    data = stream.read(count)
    if len(data) < count:
        raise CloudError(f"{path} is cut off within its elements; copy it again")
    return data
