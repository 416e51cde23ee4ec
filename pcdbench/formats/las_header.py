"""What the headers of a LAS or LAZ file promise, checked against its size before laspy and lazrs believe them.

On headers that lie, laspy 2.7 allocates all points that are promised, or loops for hours over records that are not
there, and lazrs 0.8 asks for up to 4 GB a layer of compressed points (LAS 1.4).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from pcdbench.errors import CloudError
from pcdbench.formats.columns import require_bytes, require_density

_HEADER_BYTES = 375
_SHORTEST_HEADER_BYTES = 227
_RECORD_HEADER_BYTES = 54
_EXTENDED_HEADER_BYTES = 60
_LONGEST_RECORD = 65_535  # what a record in front of the points can hold
_LASZIP_RECORD = (b"laszip encoded\0\0", 22204)
# Layers of compressed points in LASzip's items of LAS 1.4 (its specification, "layered chunked"); extra bytes have one
# layer a byte.
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_EXTRA_BYTES_ITEM = 14
_ALL_ITEMS = range(15)


def sound_point_bytes(path: Path) -> int:
    """Bytes of an unpacked point of a file whose counts, offsets and lengths fit its size and each other.

    Raises:
        CloudError: where they do not.
    """
    size = path.stat().st_size
    with path.open("rb") as stream:
        header = stream.read(_HEADER_BYTES)
        if len(header) < _SHORTEST_HEADER_BYTES or header[:4] != b"LASF":
            raise CloudError(f"{path} is not a LAS or LAZ file, or cut off; check its extension or copy it again")
        minor = header[25]
        header_bytes, points_at, records = struct.unpack_from("<HII", header, 94)
        point_format, point_bytes, count = struct.unpack_from("<BHI", header, 104)
        if minor >= 4 and len(header) == _HEADER_BYTES:
            (count,) = struct.unpack_from("<Q", header, 247)
        fits = header_bytes + _RECORD_HEADER_BYTES * records <= points_at <= size and point_bytes > 0
        if not point_format & 0xC0:
            _require(fits, path)
            require_bytes(path, count * point_bytes, count, size - points_at)
            return int(point_bytes)
        require_density(path, count)
        _require(fits and points_at + 8 <= size, path)
        items = _laszip_items(stream, header_bytes, points_at, records)
        _require(sum(length for _, length in items) == point_bytes, path)
        _require(all(kind in _ALL_ITEMS for kind, _ in items), path)
        table_at = _chunk_table(stream, points_at, size, point_bytes)
        _require(table_at > 0, path)
        if any(kind in (*_LAYERS, _EXTRA_BYTES_ITEM) for kind, _ in items):
            _require(_layers_fit(stream, points_at + 8, table_at, point_bytes, items), path)
        return int(point_bytes)


def extended_records(path: Path) -> Iterator[tuple[str, int, bytes]]:
    """(user, number, contents) of the records behind the points of a LAS 1.4 file, as far as they lie in the file."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        header = stream.read(_HEADER_BYTES)
        if len(header) < _HEADER_BYTES or header[25] < 4:
            return
        at, count = struct.unpack_from("<QI", header, 235)
        while count and at + _EXTENDED_HEADER_BYTES <= size:
            stream.seek(at)
            _, user, number, length = struct.unpack("<H16sHQ", stream.read(_EXTENDED_HEADER_BYTES)[:28])
            at += _EXTENDED_HEADER_BYTES + length
            if length <= _LONGEST_RECORD and at <= size:
                yield user.split(b"\0")[0].decode("ascii", errors="replace"), number, stream.read(length)
            count -= 1


def _require(sound: bool, path: Path) -> None:
    if not sound:
        raise CloudError(f"{path} is cut off or damaged: its header does not fit its size; copy or export it again")


def _laszip_items(stream: BinaryIO, start: int, end: int, records: int) -> list[tuple[int, int]]:
    """(kind, bytes) of each item that compressed points are made of; none where the file does not say."""
    for record in _records(stream, start, end, records):
        if len(record) < 34:
            continue
        (count,) = struct.unpack_from("<H", record, 32)
        if len(record) < 34 + 6 * count:
            continue
        found = [struct.unpack_from("<HH", record, 34 + 6 * place) for place in range(count)]
        return [(kind, length) for kind, length in found]
    return []


def _records(stream: BinaryIO, start: int, end: int, count: int) -> Iterator[bytes]:
    """The contents of the records that describe compressed points."""
    at = start
    for _ in range(count):
        if at + _RECORD_HEADER_BYTES > end:
            return
        stream.seek(at)
        _, user, number, length = struct.unpack("<H16sHH", stream.read(_RECORD_HEADER_BYTES)[:22])
        if (user, number) == _LASZIP_RECORD:
            yield stream.read(length)
        at += _RECORD_HEADER_BYTES + length


def _chunk_table(stream: BinaryIO, points_at: int, size: int, point_bytes: int) -> int:
    """Where the table of chunks is; 0 where it cannot be there or promises too many."""
    # In front of the points stands where the table is; or that its place ends the file.
    stream.seek(points_at)
    (table_at,) = struct.unpack("<q", stream.read(8))
    if table_at == -1:
        stream.seek(size - 8)
        (table_at,) = struct.unpack("<q", stream.read(8))
    if not points_at + 8 <= table_at <= size - 8:
        return 0
    stream.seek(table_at)
    _, chunks = struct.unpack("<II", stream.read(8))
    # Each chunk begins with a whole point.
    return table_at if chunks * point_bytes <= size else 0


def _layers_fit(stream: BinaryIO, start: int, end: int, point_bytes: int, items: list[tuple[int, int]]) -> bool:
    """Whether the layers of each chunk lie between the first and the table: lazrs allocates what they promise."""
    layers = sum(length if kind == _EXTRA_BYTES_ITEM else _LAYERS.get(kind, 0) for kind, length in items)
    sizes_bytes = 4 * layers
    at = start
    while at < end:
        stream.seek(at + point_bytes + 4)
        sizes = stream.read(sizes_bytes)
        if len(sizes) < sizes_bytes:
            return False
        at += point_bytes + 4 + sizes_bytes + sum(struct.unpack(f"<{layers}I", sizes))
    return at == end
