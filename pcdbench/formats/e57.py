"""E57, by pye57: all scans of a file, each moved by its pose into the file's frame."""

from __future__ import annotations

import warnings
from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats.columns import (
    NO_FIELDS,
    NOTHING,
    CloudWarning,
    Columns,
    Fields,
    color_bytes,
    needs_double,
    require_density,
    unit_colors,
)
from pcdbench.formats.e57_xml import require_plain_xml

_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_COLORS = ("colorRed", "colorGreen", "colorBlue")
_NORMALS = ("nor:normalX", "nor:normalY", "nor:normalZ")
_READ_OTHERWISE = (*_CARTESIAN, *_SPHERICAL, *_COLORS, "cartesianInvalidState", "sphericalInvalidState")


def read(path: Path, wanted: Container[str] = NOTHING) -> Columns:
    """The points of all scans in a file; invalid points become NaN.

    Colours and fields are read where every scan that holds points has them; a warning names what only some have.
    """
    import pye57

    require_plain_xml(path)
    file = pye57.E57(str(path))
    try:
        if not file.scan_count:
            raise CloudError(f"{path} has no scans (images alone, perhaps); export its points")
        require_density(path, sum(file.get_header(index).point_count for index in range(file.scan_count)))
        filled = [index for index in range(file.scan_count) if file.get_header(index).point_count]
        scans = [_scan(file, index, path, wanted) for index in filled]
    finally:
        file.close()
    if not scans:
        return Columns(np.empty((0, 3)), None)
    colors = [scan.colors for scan in scans if scan.colors is not None]
    is_colored = len(colors) == len(scans)
    names = dict.fromkeys(name for scan in scans for name in scan.fields)
    common = [name for name in names if all(name in scan.fields for scan in scans)]
    lost = [*(["colours"] if colors and not is_colored else []), *(name for name in names if name not in common)]
    if lost:
        told = f"{path}: only some of its {len(scans)} scans have {', '.join(lost)}: left out"
        warnings.warn(told, CloudWarning, 4)
    points = np.concatenate([scan.points for scan in scans])
    fields = {name: np.concatenate([scan.fields[name] for scan in scans]) for name in common}
    return Columns(points, np.concatenate(colors) if is_colored else None, fields)


def write(
    cloud: PointCloud, path: Path, fields: Fields = NO_FIELDS, exact: bool = False, like: Path | None = None
) -> str | None:
    """Write one scan; its pose carries the map offset, as pye57 stores coordinates in single precision.

    There are no fields to write (`carries_fields`), and single precision is as exact as it gets.

    Returns:
        How far points were moved where that is more than 0.05 mm, to be told.
    """
    import pye57

    offset = np.floor(cloud.points.min(axis=0) / 2 + cloud.points.max(axis=0) / 2)
    if needs_double(cloud.points - offset):
        # A stray point far away must not cost all others their digits.
        offset = np.floor(np.median(cloud.points, axis=0))
    centered = cloud.points - offset
    data = dict(zip(_CARTESIAN, centered.T, strict=True))
    if cloud.colors is not None:
        data |= dict(zip(_COLORS, color_bytes(cloud.colors).T, strict=True))
    file = pye57.E57(str(path), mode="w")
    try:
        file.write_scan_raw(data, name="cloud", rotation=np.array([1.0, 0, 0, 0]), translation=offset)
    finally:
        file.close()
    if not needs_double(centered):
        return None
    moved_m = np.abs(centered - centered.astype(np.float32)).max()
    return f"E57 is written in single precision, which moves points so far apart by up to {moved_m:.2g} m; write PLY"


def _scan(file: Any, index: int, path: Path, wanted: Container[str]) -> Columns:
    from pye57 import libe57

    header = file.get_header(index)
    fields, count = set(header.point_fields), header.point_count
    frame = next((names for names in (_CARTESIAN, _SPHERICAL) if fields.issuperset(names)), None)
    if frame is None:
        raise CloudError(f"{path}: scan {index} has neither cartesian nor spherical coordinates; export it again")
    state = "cartesianInvalidState" if frame is _CARTESIAN else "sphericalInvalidState"
    own = [*frame, *(_COLORS if fields.issuperset(_COLORS) else ()), *({state} & fields)]
    others = [name for name in header.point_fields if name in wanted and name not in _READ_OTHERWISE]
    row = libe57.StructureNode(header.points.prototype())
    others = [name for name in others if row.get(name).type() != libe57.E57_STRING]
    names = [*own, *others]
    numbers = {name: np.empty(count) for name in names}
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in numbers.items():
        buffers.append(libe57.SourceDestBuffer(file.image_file, name, column, count, True, True))
    if header.points.reader(buffers).read() < count:
        raise CloudError(f"{path}: scan {index} is cut off; copy it again")
    first, second, third = (numbers[name] for name in frame)
    points = np.stack([first, second, third] if frame is _CARTESIAN else _cartesian(first, second, third), axis=1)
    if state in numbers:
        points[numbers[state] != 0] = np.nan
    found = {name: numbers[name] for name in others}
    if header.has_pose():
        points = points @ header.rotation_matrix.T + header.translation
        found = _turned_normals(found, header.rotation_matrix)
    if not fields.issuperset(_COLORS):
        return Columns(points, None, found)
    colors = np.stack([numbers[name] for name in _COLORS], axis=1)
    return Columns(points, _scaled_colors(colors, header, path), found)


def _turned_normals(fields: dict[str, NDArray[np.float64]], rotation: NDArray[np.float64]) -> dict[str, Any]:
    """Fields with the normals among them turned as the points are."""
    if not fields.keys() >= set(_NORMALS):
        return fields
    turned = np.stack([fields[name] for name in _NORMALS], axis=1) @ rotation.T
    return fields | dict(zip(_NORMALS, turned.T, strict=True))


def _scaled_colors(colors: NDArray[np.float64], header: Any, path: Path) -> NDArray[np.float32]:
    """Colours in [0, 1] by the limits that the scan states, else by their range."""
    if header.node.isDefined("colorLimits/colorRedMaximum"):
        limit = float(header.node["colorLimits"]["colorRedMaximum"].value())
        if limit > 0 and colors.size and colors.min() >= 0 and colors.max() <= limit:
            return colors.astype(np.float32) / np.float32(limit)
    return unit_colors(colors, path)


def _cartesian(
    range_m: NDArray[np.float64], azimuth_rad: NDArray[np.float64], elevation_rad: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """x, y and z of spherical coordinates (ASTM E2807, 8.4.4)."""
    across = range_m * np.cos(elevation_rad)
    return [across * np.cos(azimuth_rad), across * np.sin(azimuth_rad), range_m * np.sin(elevation_rad)]
