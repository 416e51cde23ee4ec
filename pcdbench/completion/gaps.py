"""Where a gap in a surface is open though nobody filled it, and how large it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.completion.surface import tangents
from pcdbench.threads import thread_count

OPEN_RAD = np.radians(150.0)
RIM_NEIGHBORS = 24
WIDEST_GAP_M = 2.5
PARALLEL = 0.9
BENEATH_M = (0.25, 1.3)
# Shares of the way from the rim across the gap.
LOOKED_DOWN_AT = (0.25, 0.5, 0.75)


def gap_areas(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    spacing_m: NDArray[np.float64],
    seen: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(N,) square metres of open gap that each point on the rim of one stands for; 0 for all other points.

    A point is on a rim if a sector of 150 degrees of its plane is empty. The gap is open in the middle of that
    sector, as wide as it is to where the plane goes on: a parallel surface no more than a spacing off, within 2.5 m.
    Where it does not go on (a table's edge, the end of the scan) there is no gap. Each rim point stands for a strip
    as long as its spacing, up to the middle of the gap.

    Level gaps do not count where something was seen beneath them, 0.25 to 1.3 m lower: whoever scans holds the
    scanner higher than that, and a table that went on there would have hidden it. So desks in a row are no gaps,
    and a hole in the floor, on a table or in the ceiling is one.

    Args:
        points: (N, 3) observed and added points, metres, z up, near the origin.
        normals: (N, 3) unit.
        spacing_m: (N,).
        seen: (M, 3) observed points.
    """
    tree = cKDTree(points)
    distances, index = tree.query(points, k=min(RIM_NEIGHBORS, len(points)), workers=thread_count())
    steps = points[index] - points[:, None]
    first, second = tangents(normals)
    u, v, w = (np.einsum("nki,ni->nk", steps, axis) for axis in (first, second, normals))
    counts = (distances > 0) & (distances <= 3 * spacing_m[:, None]) & (np.abs(w) <= distances / 2)
    few = counts.sum(axis=1)
    # Angles in order, those that do not count made equal to the last that does; and once around to the first.
    angles = np.sort(np.where(counts, np.arctan2(v, u), np.inf), axis=1)
    last = np.take_along_axis(angles, np.maximum(few - 1, 0)[:, None], axis=1)
    angles = np.where(np.isfinite(angles), angles, np.where(np.isfinite(last), last, 0.0))
    angles = np.column_stack([angles, angles[:, 0] + 2 * np.pi])
    open_rad = np.diff(angles, axis=1)
    widest = open_rad.argmax(axis=1)[:, None]
    # A point with hardly any neighbours is noise and no rim.
    rim = np.flatnonzero((few >= 4) & (np.take_along_axis(open_rad, widest, axis=1)[:, 0] >= OPEN_RAD))
    middle = np.take_along_axis(angles + np.pad(open_rad, ((0, 0), (0, 1))) / 2, widest, axis=1)[rim]
    outward = first[rim] * np.cos(middle) + second[rim] * np.sin(middle)

    widths = np.zeros(len(rim))
    step = float(np.median(spacing_m))
    for reach in np.arange(3 * step, WIDEST_GAP_M, step):
        looking = np.flatnonzero(widths == 0)
        gap, found = tree.query(
            points[rim[looking]] + reach * outward[looking], distance_upper_bound=step, workers=thread_count()
        )
        hit = np.isfinite(gap)
        hit[hit] = np.abs(np.einsum("ni,ni->n", normals[found[hit]], normals[rim[looking[hit]]])) > PARALLEL
        widths[looking[hit]] = reach
    areas = np.zeros(len(points))
    areas[rim] = spacing_m[rim] * widths / 2
    level = np.flatnonzero((widths > 0) & (np.abs(normals[rim, 2]) > PARALLEL))
    across = widths[level, None, None] * outward[level, None] * np.array(LOOKED_DOWN_AT)[:, None]
    through = _seen_beneath(points[rim[level], None] + across, seen, 2 * step)
    areas[rim[level]] *= 1.0 - through.mean(axis=1)
    return areas


def _seen_beneath(places: NDArray[np.float64], seen: NDArray[np.float64], edge_m: float) -> NDArray[np.bool_]:
    """(K, S) whether a point was seen 0.25 to 1.3 m beneath (K, S, 3) places, in the same upright column of a grid."""
    flat = places.reshape(-1, 3)
    low = np.concatenate([seen, flat]).min(axis=0) - BENEATH_M[1]

    def number(points: NDArray[np.float64], lower_m: float) -> NDArray[np.int64]:
        """Columns in order, and in each the heights in order, in millimetres."""
        column = np.floor((points[:, :2] - low[:2]) / edge_m).astype(np.int64)
        height_mm = np.floor((points[:, 2] - lower_m - low[2]) * 1000).astype(np.int64)
        return (((column[:, 0] << 20) | column[:, 1]) << 20) | height_mm

    known = np.sort(number(seen, 0.0))
    first, last = (np.searchsorted(known, number(flat, lower)) for lower in BENEATH_M[::-1])
    return (last > first).reshape(places.shape[:2])
