"""What a viewer shows of each cloud: which points, which of them were added, how far they are from a reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.geometry.neighbors import nearest

# Formats keep coordinates to 0.05 mm, so that one point in two files may be twice as far from itself.
SAME_POINT_M = 1e-4
_SHARE_THAT_MAKES_A_COMPLETION = 0.5
_CORE_QUANTILES = (0.001, 0.999)
_LOWEST_CEILING_M = 1.8
# Clouds larger than buildings are, far apart from each other, say, have no ceiling, and levels without number.
_LARGEST_BUILDING_M = (10_000.0, 10_000.0, 200.0)
_PLAN_CELL_M = 0.25
_LEVEL_M = 0.1
_CEILING_SHARE_OF_PLAN = 0.25


@dataclass(frozen=True)
class Shown:
    """One cloud as a viewer shows it.

    Attributes:
        name: what people call it; any text.
        cloud: the points shown, at most as many as asked for, in random order.
        total: how many points the cloud has.
        far: how many points are left out because they lie far away from everything else.
        added: (N,) bool, which of the shown points a completer added; None where that means nothing.
        added_total: how many of all its points were added.
        confidence: (N,) in [0, 1], how far each shown point can be trusted; None where nobody says.
        compared_with: the name of the cloud whose points are the observed ones, where no mark in the file says so.
        distance_m: (N,) from each shown point to the nearest one of the reference; None without reference.
    """

    name: str
    cloud: PointCloud
    total: int
    far: int = 0
    added: NDArray[np.bool_] | None = None
    added_total: int = 0
    compared_with: str | None = None
    distance_m: NDArray[np.float64] | None = None
    confidence: NDArray[np.float64] | None = None


def shown_clouds(
    clouds: Sequence[tuple[str, PointCloud]],
    added: Sequence[NDArray[np.bool_] | None],
    reference: PointCloud | None,
    at_most: int,
    confidence: Mapping[str, NDArray[np.float64]] | None = None,
) -> list[Shown]:
    """What is shown of each named cloud.

    Args:
        clouds: at least one, in one frame, metres.
        added: for each cloud, (N,) which points were added where that is known; where it is not, the points of
            a later cloud that are no points of the first one, if at least half of the first one's are in it.
        reference: what distances are measured to.
        at_most: points of a cloud; larger ones are thinned by a random draw that is always the same.
        confidence: by name, (N,) in [0, 1], for clouds that have it.
    """
    core_low, core_high = core([cloud.points for _, cloud in clouds])
    shown = []
    for number, ((name, cloud), known) in enumerate(zip(clouds, added, strict=True)):
        # Copies of far away echoes must not shrink the room to a dot.
        near = np.flatnonzero(((cloud.points >= core_low) & (cloud.points <= core_high)).all(axis=1))
        # In random order, so that the first few stand for all while a slow machine moves them.
        kept = np.random.default_rng(0).permutation(near)[:at_most]
        marked = known
        if marked is None and number:
            marked = missing_in(cloud, clouds[0][1])
        part = cloud.select(kept)
        trust = (confidence or {}).get(name)
        shown.append(
            Shown(
                name=name,
                cloud=part,
                total=len(cloud),
                far=len(cloud) - len(near),
                added=None if marked is None else marked[kept],
                added_total=0 if marked is None else int(marked.sum()),
                compared_with=clouds[0][0] if known is None and marked is not None else None,
                distance_m=None if reference is None else nearest(part.points, reference.points)[0],
                confidence=None if trust is None else trust[kept],
            )
        )
    return shown


def missing_in(completed: PointCloud, observed: PointCloud) -> NDArray[np.bool_] | None:
    """(N,) which points of `completed` are no points of `observed`; None where it is no completion of it.

    A completion holds at least half of what was observed, to 0.1 mm.
    """
    if not len(completed) or not len(observed):
        return None
    found = nearest(completed.points, observed.points)[0] <= SAME_POINT_M
    if found.sum() < _SHARE_THAT_MAKES_A_COMPLETION * len(observed):
        return None
    return ~found


def ceiling_cut_m(points: NDArray[np.float64]) -> float | None:
    """The height (metres, as in `points`) just below the ceiling, None where there is none.

    A ceiling is a level in the upper third at which a quarter more of the floor plan has points than at most levels
    there, which only walls reach; of several (a lowered one, say) the lowest. The plan counts and not the number
    of points, because scanners see ceilings more thinly than desks.
    """
    low, high = np.quantile(points, _CORE_QUANTILES, axis=0)
    if high[2] - low[2] < _LOWEST_CEILING_M or (high - low > _LARGEST_BUILDING_M).any():
        return None
    # Strays, however far off, are no part of the plan.
    points = points[((points >= low - 1.0) & (points <= high + 1.0)).all(axis=1)]
    _, cell = np.unique(cell_numbers(points[:, :2], _PLAN_CELL_M), return_inverse=True)
    level = np.floor((points[:, 2] - low[2]) / _LEVEL_M).astype(np.int64)
    first, last = (int((high[2] - low[2]) * share / _LEVEL_M) for share in (2 / 3, 1))
    # Two neighbouring levels count as one, because a ceiling may lie on the border between them.
    shares = np.array(
        [len(np.unique(cell[(level == its) | (level == its + 1)])) / (cell.max() + 1) for its in range(first, last + 1)]
    )
    found = np.flatnonzero(shares >= np.median(shares) + _CEILING_SHARE_OF_PLAN)
    return float(low[2] + (first + found[0] - 0.5) * _LEVEL_M) if len(found) else None


def cell_numbers(coordinates: NDArray[np.float64], edge_m: float) -> NDArray[np.int64]:
    """(N,) a number for the cell of a regular grid that each of (N, D) points lies in."""
    cells = np.floor((coordinates - coordinates.min(axis=0)) / edge_m).astype(np.int64)
    return np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1)).astype(np.int64)


def core(parts: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The corners of a generous box about nearly all points of every cloud."""
    bounds = [np.quantile(points, _CORE_QUANTILES, axis=0) for points in parts if len(points)]
    low, high = np.min([lower for lower, _ in bounds], axis=0), np.max([upper for _, upper in bounds], axis=0)
    reach = max(float((high - low).max()), 1.0)
    return low - reach, high + reach
