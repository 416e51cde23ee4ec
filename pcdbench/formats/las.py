"""LAS and LAZ, by laspy and lazrs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats.columns import Columns, require_bytes, unit_colors

_SCALE_M = 1e-4
_POINTS_A_PIECE = 1_000_000


def read(path: Path) -> Columns:
    """The points of a LAS or LAZ file; colours where it has them.

    Colours that are all zero are none: point formats reserve the fields, and many programs leave them empty.
    Read in pieces, so that memory grows with what is there and not with what the header promises.
    """
    import laspy

    points, colors = [], []
    with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs) as reader:
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


def write(cloud: PointCloud, path: Path) -> None:
    """Write LAS 1.2 with coordinates of 0.1 mm from a whole-metre offset near the cloud, and 16-bit colours."""
    import laspy

    offset = np.floor(cloud.points.min(axis=0) / 2 + cloud.points.max(axis=0) / 2)
    if np.abs(cloud.points - offset).max() / _SCALE_M > np.iinfo(np.int32).max:
        raise CloudError(f"{path}: LAS holds clouds of up to 400 km at 0.1 mm; write PLY instead")
    header = laspy.LasHeader(version="1.2", point_format=0 if cloud.colors is None else 2)
    header.scales = np.full(3, _SCALE_M)
    header.offsets = offset
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.points.T
    if cloud.colors is not None:
        las.red, las.green, las.blue = np.rint(cloud.colors * np.float64(65535)).astype(np.uint16).T
    with path.open("wb") as stream:
        las.write(stream, do_compress=path.suffix.lower() == ".laz", laz_backend=laspy.LazBackend.Lazrs)
