"""LAS and LAZ, by laspy and lazrs."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats.columns import NO_FIELDS, Columns, Fields, require_bytes, unit_colors, whole_bytes

_SCALE_M = 1e-4
_EXACT_SCALES_M = (1e-4, 1e-5, 1e-6, 1e-7)
_POINTS_A_PIECE = 1_000_000
_HEADER_BYTES = 227
_RECORD_HEADER_BYTES = 54


def read(path: Path) -> Columns:
    """The points of a LAS or LAZ file; colours where it has them.

    Colours that are all zero are none: point formats reserve the fields, and many programs leave them empty.
    Read in pieces, so that memory grows with what is there and not with what the header promises.
    """
    _require_sound_header(path)
    try:
        return _columns(path)
    except BaseException as error:
        # lazrs panics on damaged data, and a panic is no Exception.
        if type(error).__name__ != "PanicException":
            raise
        raise CloudError(f"{path}: its compressed points are damaged; copy or export it again") from error


def read_fields(path: Path) -> dict[str, NDArray[Any]]:
    """The extra dimensions of a LAS or LAZ file."""
    import laspy

    _require_sound_header(path)
    with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as reader:
        las = reader.read()
    return {name: np.asarray(las[name]) for name in las.point_format.extra_dimension_names}


def _columns(path: Path) -> Columns:
    import laspy

    points, colors = [], []
    # What may follow the points (extended records) is not needed, and its number cannot be trusted.
    with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as reader:
        header = reader.header
        if not header.are_points_compressed:
            size = header.point_count * header.point_format.size
            require_bytes(path, size, header.point_count, path.stat().st_size - header.offset_to_point_data)
        has_color = "red" in header.point_format.dimension_names
        for piece in reader.chunk_iterator(_POINTS_A_PIECE):
            points.append(np.stack([np.asarray(piece[name], dtype=np.float64) for name in "xyz"], axis=1))
            if has_color:
                colors.append(np.stack([np.asarray(piece[name]) for name in ("red", "green", "blue")], axis=1))
        promised, present = header.point_count, sum(map(len, points))
    if present < promised:
        raise CloudError(f"{path} is cut off: {present:,} of {promised:,} points are there; copy it again")
    if not points:
        return Columns(np.empty((0, 3)), None)
    all_colors = np.concatenate(colors) if colors else None
    if all_colors is None or not all_colors.any():
        return Columns(np.concatenate(points), None)
    return Columns(np.concatenate(points), unit_colors(all_colors, path))


def write(cloud: PointCloud, path: Path, fields: Fields = NO_FIELDS, exact: bool = False) -> None:
    """Write LAS 1.2 with coordinates of 0.1 mm from a whole-metre offset near the cloud, and 16-bit colours.

    Fields become extra dimensions. Where it must be exact, coordinates are as fine as it takes, down to 100 nm.
    """
    import laspy

    offset = np.floor(cloud.points.min(axis=0) / 2 + cloud.points.max(axis=0) / 2)
    scale_m = _finest_needed(cloud.points - offset) if exact else _SCALE_M
    if np.abs(cloud.points - offset).max() / scale_m > np.iinfo(np.int32).max:
        raise CloudError(f"{path}: LAS holds clouds of up to 400 km at 0.1 mm; write PLY instead")
    header = laspy.LasHeader(version="1.2", point_format=0 if cloud.colors is None else 2)
    header.scales = np.full(3, scale_m)
    header.offsets = offset
    for name, field in fields.items():
        header.add_extra_dim(laspy.ExtraBytesParams(name, np.uint8 if whole_bytes(field) else np.float32))
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.points.T
    if cloud.colors is not None:
        las.red, las.green, las.blue = np.rint(cloud.colors * np.float64(65535)).astype(np.uint16).T
    for name, field in fields.items():
        las[name] = field.astype(np.uint8 if whole_bytes(field) else np.float32)
    with path.open("wb") as stream:
        las.write(stream, do_compress=path.suffix.lower() == ".laz", laz_backend=laspy.LazBackend.Lazrs)


def _finest_needed(points: NDArray[np.float64]) -> float:
    """The coarsest of the scales (metres) at which points survive to the nanometre, else the finest that fits them."""
    largest = float(np.abs(points).max())
    fitting = [scale for scale in _EXACT_SCALES_M if largest / scale < np.iinfo(np.int32).max]
    for scale in fitting:
        steps = points / scale
        if np.abs(steps - np.rint(steps)).max() * scale < 1e-9:
            return scale
    return fitting[-1] if fitting else _SCALE_M


def _require_sound_header(path: Path) -> None:
    """Refuse headers (LAS 1.4, 2.4) on which laspy loops for hours and lazrs asks for more memory than there is.

    Raises:
        CloudError: for counts and offsets that do not fit the file's size.
    """
    size = path.stat().st_size
    with path.open("rb") as stream:
        header = stream.read(_HEADER_BYTES)
        if len(header) < _HEADER_BYTES or header[:4] != b"LASF":
            raise CloudError(f"{path} is not a LAS or LAZ file, or cut off; check its extension or copy it again")
        header_size, points_at, records = struct.unpack_from("<HII", header, 94)
        point_format, point_size = struct.unpack_from("<BH", header, 104)
        sound = header_size + _RECORD_HEADER_BYTES * records <= points_at <= size and point_size > 0
        is_compressed = bool(point_format & 0xC0)
        if sound and is_compressed and points_at + 8 <= size:
            # In front of the points stands where the table of chunks is; or that its place ends the file.
            stream.seek(points_at)
            (table_at,) = struct.unpack("<q", stream.read(8))
            if table_at == -1:
                stream.seek(size - 8)
                (table_at,) = struct.unpack("<q", stream.read(8))
            sound = points_at + 8 <= table_at <= size - 8
            if sound:
                stream.seek(table_at)
                _, chunks = struct.unpack("<II", stream.read(8))
                # Each chunk begins with a whole point.
                sound = chunks * point_size <= size
    if not sound:
        raise CloudError(f"{path} is cut off or damaged: its header does not fit its size; copy or export it again")
