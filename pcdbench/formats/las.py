"""LAS and LAZ, by laspy and lazrs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats.columns import NO_FIELDS, Columns, Fields, unit_colors, whole_bytes
from pcdbench.formats.las_header import sound_point_bytes

_SCALE_M = 1e-4
_EXACT_SCALES_M = (1e-4, 1e-5, 1e-6, 1e-7)
_BYTES_A_PIECE = 1 << 25


def read(path: Path) -> Columns:
    """The points of a LAS or LAZ file; colours where it has them.

    Colours that are all zero are none: point formats reserve the fields, and many programs leave them empty.
    """
    points, colors = [], []
    for piece in _pieces(path):
        points.append(np.stack([np.asarray(piece[name], dtype=np.float64) for name in "xyz"], axis=1))
        if "red" in piece.point_format.dimension_names:
            colors.append(np.stack([np.asarray(piece[name]) for name in ("red", "green", "blue")], axis=1))
    if not points:
        return Columns(np.empty((0, 3)), None)
    all_colors = np.concatenate(colors) if colors else None
    if all_colors is None or not all_colors.any():
        return Columns(np.concatenate(points), None)
    return Columns(np.concatenate(points), unit_colors(all_colors, path))


def read_fields(path: Path) -> dict[str, NDArray[Any]]:
    """The extra dimensions of one number a point of a LAS or LAZ file."""
    found: dict[str, list[NDArray[Any]]] = {}
    for piece in _pieces(path):
        for name in piece.point_format.extra_dimension_names:
            found.setdefault(name, []).append(np.asarray(piece[name]))
    fields = {name: np.concatenate(columns) for name, columns in found.items()}
    return {name: column for name, column in fields.items() if column.ndim == 1}


def _pieces(path: Path) -> Iterator[Any]:
    """The points of a file in pieces, so that memory grows with what is there and not with what the header promises.

    Raises:
        CloudError: where the header does not fit the file, points are missing or their compression is damaged.
    """
    import laspy

    points_a_piece = max(1, _BYTES_A_PIECE // sound_point_bytes(path))
    # What may follow the points (extended records) is not needed, and its number cannot be trusted.
    with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as reader:
        promised, present = reader.header.point_count, 0
        try:
            for piece in reader.chunk_iterator(points_a_piece):
                present += len(piece)
                yield piece
        except BaseException as error:
            # lazrs panics on damaged data, and a panic is no Exception.
            if type(error).__name__ != "PanicException":
                raise
            raise CloudError(f"{path}: its compressed points are damaged; copy or export it again") from error
    if present < promised:
        raise CloudError(f"{path} is cut off: {present:,} of {promised:,} points are there; copy it again")


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
