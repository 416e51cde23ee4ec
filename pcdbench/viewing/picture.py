"""A picture of clouds side by side: from above without the ceiling, and at a slant."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.geometry.poses import rotation_about

_BACKGROUND = (1.0, 1.0, 1.0)
_MISSING = (1.0, 0.72, 0.42)
_MOST_A_ROW = 5
_PANEL_PIXELS = 560
_PANEL_INCHES = 3.4
_CEILING_SHARE = 0.85
# A disc's radius in mean spacings, were all points on the floor: they are not, so discs must be larger.
_OVERLAP = 1.15
# One point has no extent, and a picture must have one.
_SMALLEST_MARGIN_M = 0.1
_SLANT_DEG, _TURN_DEG = 52.0, 30.0


def write_picture(
    path: Path,
    clouds: Sequence[tuple[str, PointCloud]],
    title: str,
    frame: PointCloud,
    missing: Mapping[str, PointCloud] = MappingProxyType({}),
) -> None:
    """Write a PNG with two pictures of each named cloud, from above and below that at a slant; at most five a row.

    Args:
        frame: the cloud whose extent every panel shows (the complete one), so that panels line up.
        missing: by the name of a cloud, what it lacks: shown in it in orange if it has colours.
    """
    from matplotlib.figure import Figure

    rows = math.ceil(len(clouds) / _MOST_A_ROW)
    columns = math.ceil(len(clouds) / rows)
    shown = [_with_missing(cloud, missing.get(name)) for name, cloud in clouds]
    images = [[view(cloud, frame) for cloud in shown] for view in (from_above, at_a_slant)]
    heights = [views[0].shape[0] / views[0].shape[1] for views in images]
    size = _PANEL_INCHES * columns, rows * (_PANEL_INCHES * sum(heights) + 0.6) + 0.3
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=heights * rows)
    for panel in axes.flat:
        panel.set_axis_off()
    for place, (name, cloud) in enumerate(clouds):
        row, column = divmod(place, columns)
        for below, views in enumerate(images):
            axes[2 * row + below, column].imshow(views[place], interpolation="lanczos")
        lacks = f", {len(missing[name]):,} missing" if name in missing else ""
        lacks += " (orange)" if lacks and cloud.colors is not None else ""
        axes[2 * row, column].set_title(f"{name}\n{len(cloud):,} points{lacks}", fontsize=11)
    figure.suptitle(title, fontsize=12)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, facecolor="white")


def _with_missing(cloud: PointCloud, missing: PointCloud | None) -> PointCloud:
    if missing is None or cloud.colors is None:
        return cloud
    return PointCloud.concatenate([cloud, PointCloud(missing.points, np.tile(_MISSING, (len(missing), 1)))])


def splat(
    points: NDArray[np.float64],
    colors: NDArray[np.float64],
    extent: tuple[NDArray[np.float64], NDArray[np.float64]],
    radius_m: float,
) -> NDArray[np.float64]:
    """(H, W, 3) picture of points seen along -z, each a disc; the nearest (highest z) wins in every pixel.

    Args:
        points: (N, 3) in the viewer's frame: x right, y up, z toward the viewer, metres.
        colors: (N, 3) in [0, 1].
        extent: (2,) lower and upper corner of what the picture shows, metres.
    """
    low, high = extent
    scale = _PANEL_PIXELS / float((high - low).max())
    width, height = (np.ceil((high - low) * scale).astype(int) + 1).tolist()
    center = (points[:, :2] - low) * scale
    radius = max(1.0, radius_m * scale)
    reach = int(np.ceil(radius))
    steps = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    offsets = offsets[(offsets**2).sum(axis=1) <= radius**2]

    image = np.tile(np.array(_BACKGROUND), (height * width, 1))
    order = np.argsort(points[:, 2], kind="stable")
    pixels = np.round(center[order])[:, None, :].astype(int) + offsets
    inside = ((pixels >= 0) & (pixels < (width, height))).all(axis=2)
    flat = (height - 1 - pixels[..., 1]) * width + pixels[..., 0]
    # Points come from far to near, and of repeated indices numpy keeps the last assignment: the nearest.
    nearest = np.full(height * width, -1)
    nearest[flat[inside]] = np.broadcast_to(np.arange(len(points))[:, None], flat.shape)[inside]
    hit = nearest >= 0
    image[hit] = colors[order][nearest[hit]]
    return image.reshape(height, width, 3)


def from_above(cloud: PointCloud, frame: PointCloud) -> NDArray[np.float64]:
    """(H, W, 3) picture in [0, 1] of a cloud without its ceiling from above, at the frame's extent."""
    return _view(cloud, frame, np.eye(3))


def at_a_slant(cloud: PointCloud, frame: PointCloud) -> NDArray[np.float64]:
    """(H, W, 3) picture in [0, 1] of a cloud without its ceiling at a slant, at the frame's extent."""
    slanted, turned = rotation_about("x", -np.deg2rad(_SLANT_DEG)), rotation_about("z", np.deg2rad(_TURN_DEG))
    return _view(cloud, frame, slanted @ turned)


def _view(cloud: PointCloud, frame: PointCloud, R_view_scene: NDArray[np.float64]) -> NDArray[np.float64]:
    """The cloud without its ceiling, seen from this direction, at the frame's extent."""
    low, high = frame.points.min(axis=0), frame.points.max(axis=0)
    center = (low + high) / 2
    ceiling = low[2] + _CEILING_SHARE * (high[2] - low[2])
    shown = cloud.points[:, 2] <= ceiling
    points = (cloud.points[shown] - center) @ R_view_scene.T
    framed = (frame.points[frame.points[:, 2] <= ceiling] - center) @ R_view_scene.T
    corners = framed[:, :2].min(axis=0), framed[:, :2].max(axis=0)
    margin = max(0.03 * float((corners[1] - corners[0]).max()), _SMALLEST_MARGIN_M)
    # Where all but a few points far below are taken for the ceiling, the floor is far larger than what is framed.
    largest_m = 2 * (float((corners[1] - corners[0]).max()) + margin)
    floor_m2 = min(float(np.prod(np.maximum(high - low, 0.1)[:2])), largest_m**2)
    radius_m = _OVERLAP * (floor_m2 / max(1, len(frame))) ** 0.5
    return splat(points, _shaded(cloud, low, high)[shown], (corners[0] - margin, corners[1] + margin), radius_m)


def _shaded(cloud: PointCloud, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) the cloud's colours, or its height as colour; darker toward the floor, so that shapes stand out."""
    height = np.clip((cloud.points[:, 2] - low[2]) / max(float(high[2] - low[2]), 1e-9), 0.0, 1.0)
    if cloud.colors is not None:
        return np.clip(cloud.colors * (0.85 + 0.25 * height[:, None]), 0.0, 1.0)
    from matplotlib import colormaps

    return np.asarray(colormaps["viridis"](height))[:, :3]
