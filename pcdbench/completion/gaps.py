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
# Rim points are not found everywhere: between strips no farther apart than this, in spacings, all is open.
WIDEST_SLIT = 3.0
# A place is in an opening if the disc of BROAD spacings around it is open to the share FILLED; at a straight rim it is
# to half. A strip without others beside it is not: it is of a point that lacks its neighbours by chance.
BROAD, FILLED = 3.0, 0.4
# Cells and steps between samples, in spacings.
_CELL, _STEP = 1 / 2, 1 / 3
_DIRECTIONS_TRIED = 300
_WHOLE = 11  # of the 13 cells within two edges of one, itself counted: places lie off the middles of their cells


def open_gaps(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    spacing_m: NDArray[np.float64],
    seen: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where gaps are open: (G, 3) places in them, half a spacing apart, and (G,) the square metres of each.

    A point is on a rim if a sector of 150 degrees of its plane is empty. The gap is open in the middle of that
    sector, as wide as it is to where the plane goes on: a parallel surface no more than a spacing off, within 2.5 m.
    Where it does not go on (a table's edge, the end of the scan) there is no gap. Each rim point opens a strip
    across the gap. Strips overlap; they are laid on a grid in their common plane, so that every place counts once.

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
    wide = widths > 0
    rim, outward, widths = rim[wide], outward[wide], widths[wide]
    if not len(rim):
        return np.empty((0, 3)), np.empty(0)
    samples, strip = _strips(points[rim], normals[rim], outward, spacing_m[rim], widths, step)
    places, facing, areas = _union(samples, normals[rim[strip]], step)
    level = np.flatnonzero(np.abs(facing[:, 2]) > PARALLEL)
    gap, _ = tree.query(places, workers=thread_count())
    is_open = np.asarray(gap > _CELL * step)
    through = level[_seen_beneath(places[level], seen, 2 * step)]
    if len(through):
        # Columns at a table's edge lie half beneath it.
        gap, _ = cKDTree(places[through]).query(places[level], workers=thread_count())
        is_open[level] &= gap > 3 * step
    return places[is_open], areas[is_open]


def _strips(
    rims: NDArray[np.float64],
    normals: NDArray[np.float64],
    outward: NDArray[np.float64],
    spacing_m: NDArray[np.float64],
    widths_m: NDArray[np.float64],
    step_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(S, 3) samples of the strip before each of (R, 3) rim points, and (S,) whose strip it is.

    Strips are as wide as their spacing, begin half of one from the rim point and end as far from the other side.
    """
    pitch = _STEP * step_m
    sides = np.stack([widths_m - spacing_m, spacing_m])
    along, across = np.maximum(1, np.round(sides / pitch)).astype(np.int64)
    count = along * across
    strip = np.repeat(np.arange(len(rims)), count)
    number = np.arange(len(strip)) - np.repeat(np.cumsum(count) - count, count)
    reach = spacing_m[strip] / 2 + (number // across[strip] + 0.5) * pitch
    aside = ((number % across[strip] + 0.5) / across[strip] - 0.5) * spacing_m[strip]
    sideways = np.cross(normals, outward)
    return rims[strip] + reach[:, None] * outward[strip] + aside[:, None] * sideways[strip], strip


def _union(
    samples: NDArray[np.float64], normals: NDArray[np.float64], step_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """(G, 3) places that samples cover, slits between them too, (G, 3) the normal there, (G,) the area of each.

    Grids lie across the directions that most normals share.
    """
    places, facing, areas = [], [], []
    left = np.arange(len(samples))
    while len(left):
        tried = normals[left[:: -(-len(left) // _DIRECTIONS_TRIED)]]
        direction = tried[(np.abs(tried @ tried.T) > PARALLEL).sum(axis=0).argmax()]
        across = np.abs(normals[left] @ direction)
        rows, left = left[across > PARALLEL], left[across <= PARALLEL]
        found = _one_a_cell(samples[rows], direction, step_m)
        # Slits lie between what has not all of its neighbours; between all the others pairs would be millions.
        whole = cKDTree(found).query_ball_point(found, 2 * _CELL * step_m, return_length=True, workers=thread_count())
        edge = found[whole < _WHOLE]
        pairs = cKDTree(edge).query_pairs(WIDEST_SLIT * step_m, output_type="ndarray")
        pairs = pairs[np.abs((edge[pairs[:, 0]] - edge[pairs[:, 1]]) @ direction) <= step_m]
        found = _one_a_cell(np.concatenate([found, edge[pairs].mean(axis=1)]), direction, step_m)
        around = cKDTree(found).query_ball_point(found, BROAD * step_m, return_length=True, workers=thread_count())
        found = found[around >= FILLED * np.pi * (BROAD / _CELL) ** 2]
        places.append(found)
        facing.append(np.tile(direction, (len(found), 1)))
        # What leans out of the grid is larger than its cells.
        areas.append(np.full(len(found), (_CELL * step_m) ** 2 / across[across > PARALLEL].mean()))
    return np.concatenate(places), np.concatenate(facing), np.concatenate(areas)


def _one_a_cell(places: NDArray[np.float64], direction: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    """(G, 3) the mean of (N, 3) places in each cell of a grid across a direction.

    In one cell, places farther apart than a spacing along the direction are of two surfaces.
    """
    first, second = tangents(direction[None])
    depth = places @ direction
    cells = np.floor(places @ np.concatenate([first, second]).T / (_CELL * step_m))
    order = np.lexsort([depth, cells[:, 1], cells[:, 0]])
    begins = (np.diff(cells[order], axis=0, prepend=np.inf) != 0).any(axis=1)
    begins |= np.diff(depth[order], prepend=-np.inf) > step_m
    starts = np.flatnonzero(begins)
    counts = np.diff(np.append(starts, len(places)))
    means: NDArray[np.float64] = np.add.reduceat(places[order], starts) / counts[:, None]
    return means


def _seen_beneath(places: NDArray[np.float64], seen: NDArray[np.float64], edge_m: float) -> NDArray[np.bool_]:
    """(K,) whether a point was seen 0.25 to 1.3 m beneath (K, 3) places, in the same upright column of a grid."""
    low = np.concatenate([seen, places]).min(axis=0) - BENEATH_M[1]

    def number(points: NDArray[np.float64], lower_m: float) -> NDArray[np.int64]:
        """Columns in order, and in each the heights in order, in millimetres."""
        column = np.floor((points[:, :2] - low[:2]) / edge_m).astype(np.int64)
        height_mm = np.floor((points[:, 2] - lower_m - low[2]) * 1000).astype(np.int64)
        return (((column[:, 0] << 20) | column[:, 1]) << 20) | height_mm

    known = np.sort(number(seen, 0.0))
    first, last = (np.searchsorted(known, number(places, lower)) for lower in BENEATH_M[::-1])
    return np.asarray(last > first, np.bool_)
