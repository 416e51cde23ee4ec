"""NPZ: NumPy arrays `points` (N, 3) and, where there is colour, `colors` (N, 3)."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats.columns import NO_FIELDS, Columns, Fields, require_bytes, unit_colors

# Deflate shrinks nothing to less than a 1032nd (zlib's own figure).
_MOST_DEFLATED = 1032


def read(path: Path) -> Columns:
    """The arrays `points` and `colors`; pickled objects are refused."""
    if not zipfile.is_zipfile(path):
        raise CloudError(f"{path} is not an NPZ file, or cut off; write it by numpy.savez(path, points=...)")
    with zipfile.ZipFile(path) as archive:
        members = {Path(name).stem: name for name in archive.namelist()}
        if "points" not in members:
            raise CloudError(f"{path} has no array 'points'; write it by numpy.savez(path, points=..., colors=...)")
        points = _array(archive, members["points"], path)
        colors = _array(archive, members["colors"], path) if "colors" in members else None
    if colors is not None and colors.shape != points.shape:
        raise CloudError(f"{path}: colors has shape {colors.shape}, points {points.shape}; they must be equal")
    return Columns(points.astype(np.float64), None if colors is None else unit_colors(colors, path))


def read_fields(path: Path) -> dict[str, NDArray[Any]]:
    """All other arrays of one number a point."""
    with np.load(path, allow_pickle=False) as arrays:
        count = len(arrays["points"])
        return {name: arrays[name] for name in arrays.files if arrays[name].shape == (count,)}


def write(cloud: PointCloud, path: Path, fields: Fields = NO_FIELDS, exact: bool = False) -> None:
    """Write double coordinates and float32 colours, compressed: nothing is lost, asked or not."""
    arrays: dict[str, Any] = {"points": cloud.points, **fields}
    if cloud.colors is not None:
        arrays["colors"] = cloud.colors
    with path.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


def _array(archive: zipfile.ZipFile, member: str, path: Path) -> NDArray[Any]:
    name = Path(member).stem
    info = archive.getinfo(member)
    with archive.open(member) as stream:
        version = npy.read_magic(stream)
        header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, kind = header(stream)
    if kind.kind not in "iuf" or len(shape) != 2 or shape[1] != 3:
        raise CloudError(f"{path}: {name} must hold numbers of shape (N, 3), not {kind} of shape {shape}")
    present = min(info.file_size, _MOST_DEFLATED * min(info.compress_size, path.stat().st_size))
    require_bytes(path, shape[0] * 3 * kind.itemsize, shape[0], present)
    with archive.open(member) as stream:
        return npy.read_array(stream, allow_pickle=False)
