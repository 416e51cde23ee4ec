"""How well what was observed supports a proposed point, and where nothing was proposed though a gap is open."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.completion.surface import tangents
from pcdbench.geometry.sampling import apart_indices
from pcdbench.threads import thread_count

SECTORS = 8
NEAREST = 12
SURROUNDING = 48
# At this distance from the nearest observed point (metres) the factor of distance is 1/e.
FADING_M = 2.0
OPEN_RAD = np.radians(150.0)
RIM_NEIGHBORS = 24
WIDEST_GAP_M = 2.5
PARALLEL = 0.9


def evidence(
    proposed: NDArray[np.float64],
    proposed_normals: NDArray[np.float64],
    observed: NDArray[np.float64],
    observed_normals: NDArray[np.float64],
    spacing_m: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """(K, 3) in [0, 1]: the factors of distance, agreement and enclosure of each proposed point.

    - distance: exp(-d / 2 m), d the distance to the nearest observed point.
    - agreement: exp(-h / s), s the spacing, h the distance of the point from the planes of its 12 nearest observed
      points: the lower quartile, so that at an edge one of two surfaces is enough.
    - enclosure: (1 + e) / 2, e the share of eight sectors of the point's plane in which observed points continue
      it: no higher above it than a quarter of their distance and half a spacing. Between observed surfaces a
      completer interpolates; beyond them it guesses.

    Args:
        proposed: (K, 3) metres, near the origin.
        proposed_normals: (K, 3) unit.
        observed: (N, 3) metres, N at least 1.
        observed_normals: (N, 3) unit.
        spacing_m: of the observed points.
        rng: decides which observed points stand for their surroundings.
    """
    if not len(proposed):
        return np.empty((0, 3))
    tree = cKDTree(observed)
    distances, index = tree.query(proposed, k=min(NEAREST, len(observed)), workers=thread_count())
    distances, index = distances.reshape(len(proposed), -1), index.reshape(len(proposed), -1)
    heights = np.abs(np.einsum("nki,nki->nk", observed_normals[index], proposed[:, None] - observed[index]))
    distance = np.exp(-distances[:, 0] / FADING_M)
    agreement = np.exp(-np.quantile(heights, 0.25, axis=1) / spacing_m)

    coarse = observed[apart_indices(observed, 2 * spacing_m, rng)]
    _, around = cKDTree(coarse).query(proposed, k=min(SURROUNDING, len(coarse)), workers=thread_count())
    steps = coarse[around.reshape(len(proposed), -1)] - proposed[:, None]
    first, second = tangents(proposed_normals)
    u, v, w = (np.einsum("nki,ni->nk", steps, axis) for axis in (first, second, proposed_normals))
    continues = np.abs(w) <= 0.25 * np.hypot(u, v) + 0.5 * spacing_m
    sector = np.floor((np.arctan2(v, u) + np.pi) / (2 * np.pi) * SECTORS).astype(np.int64) % SECTORS
    met = np.zeros((len(proposed), SECTORS), np.bool_)
    rows = np.broadcast_to(np.arange(len(proposed))[:, None], sector.shape)
    met[rows[continues], sector[continues]] = True
    return np.stack([distance, agreement, (1 + met.mean(axis=1)) / 2], axis=1)


def gap_areas(
    points: NDArray[np.float64], normals: NDArray[np.float64], spacing_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N,) square metres of open gap that each point on the rim of one stands for; 0 for all other points.

    A point is on a rim if a sector of 150 degrees of its plane is empty. The gap is open in the middle of that
    sector, as wide as it is to where the plane goes on: a parallel surface no more than a spacing off, within 2.5 m.
    Where it does not go on (a table's edge, the end of the scan) there is no gap. Each rim point stands for a strip
    as long as its spacing, up to the middle of the gap.

    Args:
        points: (N, 3) observed and added points, metres, near the origin.
        normals: (N, 3) unit.
        spacing_m: (N,).
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
    return areas
