"""NPZ: NumPy arrays `points` (N, 3) and, where there is colour, `colors` (N, 3)."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats.columns import (
    NO_FIELDS,
    NOTHING,
    Columns,
    Fields,
    own_name,
    require_bytes,
    require_density,
    unit_colors,
)

# Deflate shrinks nothing to less than a 1032nd (zlib's own figure).
_MOST_DEFLATED = 1032
_MOST_NUMBERS = 100  # of a point, in a file with as many bytes as points
_OWN = ("points", "colors")
_LONGEST_NAME = 100
_UNFIT = {"/", "\\", "\0", "."}


def read(path: Path, wanted: Container[str] = NOTHING) -> Columns:
    """The arrays `points` and `colors`, and all others with a row a point; pickled objects are refused."""
    with _archive(path) as archive:
        members = _members(archive, path)
        points = _rows_of_three(archive, members["points"], path)
        colors = _rows_of_three(archive, members["colors"], path) if "colors" in members else None
        others = {name: member for name, member in members.items() if name in wanted and name not in _OWN}
        headers = {name: _shape_and_type(archive, member) for name, member in others.items()}
        names = [
            name
            for name, (shape, kind) in headers.items()
            if shape[:1] == points.shape[:1] and len(shape) <= 2 and 0 not in shape[1:] and kind.kind in "biuf"
        ]
        # Fields that hardly change take next to no bytes; only many of them together are more than anyone writes.
        require_density(path, sum(math.prod(headers[name][0]) for name in names) // _MOST_NUMBERS)
        fields = {name: _array(archive, others[name], path) for name in names}
    if colors is not None and colors.shape != points.shape:
        raise CloudError(f"{path}: colors has shape {colors.shape}, points {points.shape}; they must be equal")
    return Columns(points.astype(np.float64), None if colors is None else unit_colors(colors, path), fields)


def write(
    cloud: PointCloud, path: Path, fields: Fields = NO_FIELDS, exact: bool = False, like: Path | None = None
) -> None:
    """Write double coordinates and float32 colours, compressed: nothing is lost, asked or not."""
    arrays: dict[str, Any] = {"points": cloud.points}
    if cloud.colors is not None:
        arrays["colors"] = cloud.colors
    taken = {*_OWN, "file"}
    for name, values in fields.items():
        # Archives have folders, and their names no end.
        is_plain = bool(name) and name not in taken and not _UNFIT & set(name) and len(name) <= _LONGEST_NAME
        arrays[name if is_plain else own_name(name, taken, _LONGEST_NAME)] = values
        taken |= arrays.keys()
    with path.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


def _archive(path: Path) -> zipfile.ZipFile:
    if not zipfile.is_zipfile(path):
        raise CloudError(f"{path} is not an NPZ file, or cut off; write it by numpy.savez(path, points=...)")
    return zipfile.ZipFile(path)


def _members(archive: zipfile.ZipFile, path: Path) -> dict[str, str]:
    """The arrays of a file by their names; `points` is among them."""
    members = {Path(info.filename).stem: info for info in archive.infolist()}
    if "points" not in members:
        raise CloudError(f"{path} has no array 'points'; write it by numpy.savez(path, points=..., colors=...)")
    # What else zip knows may ask for gigabytes to unpack a byte (LZMA's dictionary).
    if any(info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for info in members.values()):
        raise CloudError(f"{path} is packed as NumPy never packs; write it by numpy.savez_compressed")
    return {name: info.filename for name, info in members.items()}


def _rows_of_three(archive: zipfile.ZipFile, member: str, path: Path) -> NDArray[Any]:
    shape, kind = _shape_and_type(archive, member)
    if kind.kind not in "iuf" or len(shape) != 2 or shape[1] != 3:
        raise CloudError(f"{path}: {Path(member).stem} must hold numbers of shape (N, 3), not {kind} of shape {shape}")
    return _array(archive, member, path)


def _shape_and_type(archive: zipfile.ZipFile, member: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    with archive.open(member) as stream:
        version = npy.read_magic(stream)
        header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, kind = header(stream)
    return shape, kind


def _array(archive: zipfile.ZipFile, member: str, path: Path) -> NDArray[Any]:
    """An array that cannot be larger than what its file may hold."""
    info = archive.getinfo(member)
    shape, kind = _shape_and_type(archive, member)
    size = math.prod(shape) * kind.itemsize
    packed = min(info.compress_size, path.stat().st_size)
    require_bytes(path, size, shape[0] if shape else 0, min(info.file_size, _MOST_DEFLATED * packed))
    require_density(path, shape[0] if shape else 0)
    with archive.open(member) as stream:
        return npy.read_array(stream, allow_pickle=False)
