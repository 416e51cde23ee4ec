"""Reading and writing clouds: PLY, PCD, text, LAS/LAZ, E57 and NPZ, by the file's extension."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError, PcdbenchError
from pcdbench.files import whole_file
from pcdbench.formats.columns import EVERYTHING, NO_FIELDS, NOTHING, CloudWarning, Columns, Fields, needs_double

__all__ = [
    "EXTENSIONS",
    "MARKS",
    "CloudWarning",
    "carries_fields",
    "read_cloud",
    "read_cloud_and_fields",
    "read_observed",
    "write_cloud",
]

_MODULE_OF_EXTENSION = {
    ".ply": "ply",
    ".pcd": "pcd",
    ".xyz": "text",
    ".txt": "text",
    ".csv": "text",
    ".asc": "text",
    ".pts": "text",
    ".las": "las",
    ".laz": "las",
    ".e57": "e57",
    ".npz": "npz",
}
EXTENSIONS = tuple(_MODULE_OF_EXTENSION)
_WITHOUT_FIELDS = (".e57", ".pts")
_MESH_EXTENSIONS = (".obj", ".stl", ".off", ".gltf", ".glb", ".dae", ".fbx", ".3ds")

# What `pcdbench complete` writes of each point: whether it was added (0 or 1), and how far it can be trusted.
MARKS = ("added", "confidence")
# What CloudCompare calls them when it saves a PLY file again.
_MARKS_SAVED_AGAIN = tuple(f"scalar_{name}" for name in MARKS)
# Of coordinates that a file should hold more finely.
_COARSEST_STEP_M = 0.002

# Scanners write huge numbers where nothing came back; no map has coordinates like these.
_FARTHEST_M = 1e10
_FEW_WITHOUT_COLOR = 0.01


def read_cloud(path: Path) -> PointCloud:
    """The cloud in a file, in the file's own frame and unit.

    Rows without valid coordinates (NaN, infinite, beyond 10^10, marked as invalid or withheld) are dropped, with a
    `CloudWarning` that says how many: real scanners write such rows wherever nothing came back.

    Raises:
        CloudError: naming the file and the cure, whatever is wrong with it.
    """
    return _read(Path(path), NOTHING)[0]


def read_cloud_and_fields(path: Path) -> tuple[PointCloud, dict[str, NDArray[Any]]]:
    """The cloud in a file, and what the file holds of each point besides: {name: (N,) or (N, K) numbers}.

    Raises:
        CloudError: naming the file and the cure, whatever is wrong with it.
    """
    return _read(Path(path), EVERYTHING)


def read_observed(path: Path, *, with_fields: bool = False) -> tuple[PointCloud, dict[str, NDArray[Any]]]:
    """The cloud in a file without the points that `pcdbench complete` added to it; its fields if they are asked for.

    Points are told by the fields `added` and `confidence` that it writes. A `CloudWarning` says how many were left out.

    Raises:
        CloudError: naming the file and the cure, whatever is wrong with it, and where all of its points were added.
    """
    path = Path(path)
    cloud, fields = _read(path, EVERYTHING if with_fields else (*MARKS, *_MARKS_SAVED_AGAIN))
    added, others = fields.get(MARKS[0]), {name: values for name, values in fields.items() if name not in MARKS}
    if added is None or added.ndim != 1 or MARKS[1] not in fields or not np.isin(added, (0, 1)).all():
        return cloud, fields if with_fields else {}
    seen = added == 0
    if not seen.any():
        raise CloudError(f"{path}: a completion added all of its points; name the scan that they were added to")
    if seen.all():
        return cloud, others
    count = int((~seen).sum())
    warnings.warn(
        f"{path}: a completion added {count:,} of its points; they are no observation: left out", CloudWarning, 3
    )
    return cloud.select(seen), {name: values[seen] for name, values in others.items()}


def carries_fields(path: Path) -> bool:
    """Whether the format of the path's extension can hold further fields of each point.

    Raises:
        CloudError: for an unknown extension.
    """
    _format_module(Path(path))
    return Path(path).suffix.lower() not in _WITHOUT_FIELDS


def _read(path: Path, wanted: Container[str]) -> tuple[PointCloud, dict[str, NDArray[Any]]]:
    """The cloud of a file and the wanted fields of its points, every failure made one line."""
    try:
        if path.is_dir():
            raise CloudError(f"{path} is a folder; name one of its files, or use it as a data set: clouds:{path}")
        module = _format_module(path)
        if not path.exists():
            raise CloudError(f"{path}: there is no such file; check the path")
        if not path.is_file():
            raise CloudError(f"{path} is a pipe or a device; write what comes out of it to a file, and name that")
        if path.stat().st_size == 0:
            raise CloudError(f"{path} is empty (0 bytes); export or copy it again")
        columns = module.read(path, wanted)
    except PcdbenchError:
        raise
    except MemoryError as error:
        raise CloudError(f"{path} does not fit into memory; thin it first") from error
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None:
            raise CloudError(f"{path} cannot be read: {error.strerror}; check the path and its permissions") from error
        # Six parsers, three of them not ours, meet arbitrary bytes here: none of their errors is a bug of the caller.
        # libe57 puts its source lines after asterisks.
        reason = " ".join(str(error).split("****")[0].split())[:200] or type(error).__name__
        raise CloudError(f"{path} cannot be read as {path.suffix[1:].upper()} ({reason}); export it again") from error
    return _valid(columns, path)


def write_cloud(
    cloud: PointCloud, path: Path, fields: Fields = NO_FIELDS, *, exact: bool = False, like: Path | None = None
) -> None:
    """Write a cloud; its folder is created, and the file appears complete or not at all.

    Coordinates keep 0.05 mm at any map offset; colours are rounded to 8 bits, in LAS and LAZ to 16, and kept
    as they are in NPZ. A `CloudWarning` says where E57, LAS or PLY keeps less.

    Args:
        cloud: at least one point.
        path: its extension decides the format.
        fields: further numbers of each point, (N,) or (N, K), kept in their own type where the format has it. In LAS
            those of the names of its own dimensions (`intensity`) are these; K columns are numbered but in NPZ.
        exact: coordinates are kept to the last bit in PLY, PCD (double where float would round at all) and
            NPZ, to a nanometre in text, and in LAS wherever a scale down to 100 nm reaches them.
        like: a file of the same format whose coordinate reference system (LAS, LAZ) or VIEWPOINT (PCD) is taken over.

    Raises:
        CloudError: for an empty cloud, an unknown extension, fields of another length or where the format has none
            (E57), or a place that cannot be written.
    """
    path = Path(path)
    module = _format_module(path)
    if not len(cloud):
        raise CloudError(f"{path}: the cloud to be written has no points")
    if fields and not carries_fields(path):
        raise CloudError(f"{path}: {path.suffix} files cannot hold {', '.join(fields)}; write PLY, LAS or NPZ")
    odd = [name for name, values in fields.items() if values.shape[:1] != (len(cloud),) or values.ndim > 2]
    if odd:
        raise CloudError(f"{path}: field {odd[0]} must have a row for each of the {len(cloud):,} points")
    try:
        if path.is_dir():
            raise CloudError(f"{path} is a folder; name a file in it")
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as unfinished:
            try:
                lost = module.write(cloud, unfinished, fields, exact, like)
            except CloudError as error:
                raise CloudError(str(error).replace(str(unfinished), str(path))) from error
    except CloudError:
        raise
    except OSError as error:
        raise CloudError(f"{path} cannot be written: {error.strerror or error}; choose another place") from error
    except Exception as error:
        # Writers that are not ours meet names and numbers of any file here.
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        kind = path.suffix[1:].upper()
        raise CloudError(f"{path} cannot be written as {kind} ({reason}); write PLY or NPZ") from error
    if lost is not None:
        warnings.warn(f"{path}: {lost}", CloudWarning, 2)


def _format_module(path: Path) -> Any:
    """The module that reads and writes this extension; its libraries load only when it works."""
    extension = path.suffix.lower()
    if extension in _MESH_EXTENSIONS:
        raise CloudError(f"{path}: {extension} is for meshes, not clouds; sample points on a mesh, and use PLY")
    if extension not in _MODULE_OF_EXTENSION:
        kind = f"{extension} is not a format" if extension else "without an extension nobody knows the format"
        raise CloudError(f"{path}: {kind}; use one of {' '.join(EXTENSIONS)}")
    return importlib.import_module(f"pcdbench.formats.{_MODULE_OF_EXTENSION[extension]}")


def _valid(columns: Columns, path: Path) -> tuple[PointCloud, dict[str, NDArray[Any]]]:
    points, colors, fields = columns.points, columns.colors, columns.fields
    count = len(points)
    if not count:
        raise CloudError(f"{path} has no points; export it again")
    # NaN compares false.
    valid = (np.abs(points) <= _FARTHEST_M).all(axis=1)
    bad = count - int(valid.sum())
    if bad == count:
        raise CloudError(f"{path}: none of its {count:,} points has valid coordinates; export it again")
    if bad:
        warnings.warn(
            f"{path}: {bad:,} of {count:,} points are not valid (NaN, or marked so): dropped", CloudWarning, 4
        )
        points, colors = points[valid], None if colors is None else colors[valid]
        fields = {name: values[valid] for name, values in fields.items()}
    colors = _known_colors(colors, path)
    if fields.keys() >= set(_MARKS_SAVED_AGAIN) and not fields.keys() & set(MARKS):
        named = dict(zip(_MARKS_SAVED_AGAIN, MARKS, strict=True))
        fields = {named.get(name, name): values for name, values in fields.items()}
    _warn_of_steps(points, path)
    try:
        return PointCloud(points, colors), fields
    except CloudError as error:
        raise CloudError(f"{path}: {error}") from error


def _known_colors(colors: NDArray[np.float32] | None, path: Path) -> NDArray[np.float32] | None:
    """The colours, where all points or nearly all have one: what a station without a camera saw is still surface."""
    if colors is None:
        return None
    unknown = np.flatnonzero(~np.isfinite(colors).all(axis=1))
    if not len(unknown):
        return colors
    few = len(unknown) <= _FEW_WITHOUT_COLOR * len(colors)
    cure = "these are grey" if few else "the colours of all are left out"
    warnings.warn(f"{path}: {len(unknown):,} of its points have no valid colour; {cure}", CloudWarning, 5)
    if not few:
        return None
    colors = colors.copy()
    colors[unknown] = 0.5
    return colors


def _warn_of_steps(points: NDArray[np.float64], path: Path) -> None:
    """Single precision far from the origin: what it lost cannot be brought back, but should be known."""
    farthest = float(np.abs(points).max())
    step_m = float(np.spacing(np.float32(farthest)))
    if step_m > _COARSEST_STEP_M and not needs_double(points, exact=True):
        warnings.warn(
            f"{path}: its coordinates are in single precision, which {farthest:,.0f} m from the origin has steps of "
            f"{step_m:.2g} m; export it in double precision, or around an origin nearby",
            CloudWarning,
            5,
        )
