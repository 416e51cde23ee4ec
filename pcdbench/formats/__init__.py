"""Reading and writing clouds: PLY, PCD, text, LAS/LAZ, E57 and NPZ, by the file's extension."""

from __future__ import annotations

import importlib
import os
import secrets
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError, PcdbenchError
from pcdbench.formats.columns import NO_FIELDS, CloudWarning, Columns, Fields

__all__ = ["EXTENSIONS", "CloudWarning", "carries_fields", "read_cloud", "read_fields", "write_cloud"]

_MODULE_OF_EXTENSION = {
    ".ply": "ply",
    ".pcd": "pcd",
    ".xyz": "text",
    ".txt": "text",
    ".csv": "text",
    ".asc": "text",
    ".las": "las",
    ".laz": "las",
    ".e57": "e57",
    ".npz": "npz",
}
EXTENSIONS = tuple(_MODULE_OF_EXTENSION)
_WITHOUT_FIELDS = (".e57",)
_MESH_EXTENSIONS = (".obj", ".stl", ".off", ".gltf", ".glb", ".dae", ".fbx", ".3ds")

# Scanners write huge numbers where nothing came back; no map has coordinates like these.
_FARTHEST_M = 1e10


def read_cloud(path: Path) -> PointCloud:
    """The cloud in a file, in the file's own frame and unit.

    Rows without valid coordinates (NaN, infinite, beyond 10^10) are dropped, with a `CloudWarning` that says
    how many: real scanners write such rows wherever nothing came back.

    Raises:
        CloudError: naming the file and the cure, whatever is wrong with it.
    """
    path = Path(path)
    return _valid_cloud(_read(path, "read"), path)


def read_fields(path: Path) -> dict[str, NDArray[Any]]:
    """What a file holds of each point besides coordinates and colours: {name: (N,) numbers}, one for each row.

    Rows without valid coordinates, which `read_cloud` drops, are among them.

    Raises:
        CloudError: naming the file and the cure, whatever is wrong with it.
    """
    path = Path(path)
    if not carries_fields(path):
        raise CloudError(f"{path}: {path.suffix} files are read for coordinates and colours alone; use PLY or NPZ")
    fields: dict[str, NDArray[Any]] = _read(path, "read_fields")
    return fields


def carries_fields(path: Path) -> bool:
    """Whether the format of the path's extension can hold further fields of each point.

    Raises:
        CloudError: for an unknown extension.
    """
    _format_module(Path(path))
    return Path(path).suffix.lower() not in _WITHOUT_FIELDS


def _read(path: Path, what: str) -> Any:
    """What the format's function of this name reads, every failure made one line."""
    module = _format_module(path)
    if not path.exists():
        raise CloudError(f"{path}: there is no such file; check the path")
    if path.is_dir():
        raise CloudError(f"{path} is a folder; name one of its files, or use it as a data set: clouds:{path}")
    try:
        if path.stat().st_size == 0:
            raise CloudError(f"{path} is empty (0 bytes); export or copy it again")
        return getattr(module, what)(path)
    except PcdbenchError:
        raise
    except MemoryError as error:
        raise CloudError(f"{path} does not fit into memory; thin it first") from error
    except Exception as error:
        # Six parsers, three of them not ours, meet arbitrary bytes here: none of their errors is a bug of the caller.
        # libe57 puts its source lines after asterisks.
        reason = " ".join(str(error).split("****")[0].split())[:200] or type(error).__name__
        raise CloudError(f"{path} cannot be read as {path.suffix[1:].upper()} ({reason}); export it again") from error


def write_cloud(cloud: PointCloud, path: Path, fields: Fields = NO_FIELDS, *, exact: bool = False) -> None:
    """Write a cloud; its folder is created, and the file appears complete or not at all.

    Coordinates keep 0.05 mm at any map offset; colours are rounded to 8 bits, in LAS and LAZ to 16, and kept
    as they are in NPZ.

    Args:
        cloud: at least one point.
        path: its extension decides the format.
        fields: further numbers of each point, (N,) bool or uint8 (written as 8-bit whole numbers) or float32.
        exact: coordinates are kept to the last bit in PLY, PCD (double where float would round at all) and
            NPZ, to a nanometre in text, and in LAS wherever a scale down to 100 nm reaches them.

    Raises:
        CloudError: for an empty cloud, an unknown extension, fields where the format has none (E57), or a place
            that cannot be written.
    """
    path = Path(path)
    module = _format_module(path)
    if not len(cloud):
        raise CloudError(f"{path}: the cloud to be written has no points")
    if path.is_dir():
        raise CloudError(f"{path} is a folder; name a file in it")
    if fields and not carries_fields(path):
        raise CloudError(f"{path}: {path.suffix} files cannot hold {', '.join(fields)}; write PLY, LAS or NPZ")
    unfinished = path.with_name(f".{path.stem[:100]}-{secrets.token_hex(4)}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        module.write(cloud, unfinished, fields, exact)
        os.replace(unfinished, path)
    except OSError as error:
        raise CloudError(f"{path} cannot be written: {error.strerror or error}; choose another place") from error
    finally:
        unfinished.unlink(missing_ok=True) if unfinished.parent.is_dir() else None


def _format_module(path: Path) -> Any:
    """The module that reads and writes this extension; its libraries load only when it works."""
    extension = path.suffix.lower()
    if extension in _MESH_EXTENSIONS:
        raise CloudError(f"{path} holds a mesh, not a cloud; sample points on it and save them as PLY")
    if extension not in _MODULE_OF_EXTENSION:
        kind = f"{extension} is not a format" if extension else "without an extension nobody knows the format"
        raise CloudError(f"{path}: {kind}; use one of {' '.join(EXTENSIONS)}")
    return importlib.import_module(f"pcdbench.formats.{_MODULE_OF_EXTENSION[extension]}")


def _valid_cloud(columns: Columns, path: Path) -> PointCloud:
    count = len(columns.points)
    if not count:
        raise CloudError(f"{path} has no points; export it again")
    # NaN compares false.
    valid = (np.abs(columns.points) <= _FARTHEST_M).all(axis=1)
    if columns.colors is not None:
        valid &= np.isfinite(columns.colors).all(axis=1)
    bad = count - int(valid.sum())
    if bad == count:
        raise CloudError(f"{path}: none of its {count:,} points has valid coordinates; export it again")
    try:
        if not bad:
            return PointCloud(columns.points, columns.colors)
        warnings.warn(f"{path}: {bad:,} of {count:,} points are not valid (NaN, say): dropped", CloudWarning, 3)
        return PointCloud(columns.points[valid], None if columns.colors is None else columns.colors[valid])
    except CloudError as error:
        raise CloudError(f"{path}: {error}") from error
