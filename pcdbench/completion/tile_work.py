"""What is done in one tile, alone: thin it, complete it, keep what is new, bring that to the density around it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.cloud import PointCloud
from pcdbench.completer import Completer
from pcdbench.completion.densify import at_density
from pcdbench.completion.evidence import evidence
from pcdbench.completion.gaps import open_gaps
from pcdbench.completion.surface import RADIUS_OF_SPACING, local_planes, spacing_at, spacing_inside
from pcdbench.completion.tiles import FINEST_SPACING_M, WORKING_POINTS
from pcdbench.errors import PluginError
from pcdbench.formats.columns import LARGEST_FLOAT32_ERROR_M
from pcdbench.geometry.duplicates import repeats
from pcdbench.geometry.sampling import poisson_disk_indices
from pcdbench.keys import seed_from
from pcdbench.threads import thread_count

FEWEST_POINTS = 50
# Of a random sample of a surface, one place in 300 is farther than this many spacings from all its points.
NEW_BEYOND = 1.35
AGREES_WITHIN = 1.5
MOST_TO_THIN = 1_500_000
# No denser than this share of the tile's typical spacing: under a scanner's tripod points lie a millimetre apart.
DENSEST = 0.5
INTERPOLATED = 3


@dataclass(frozen=True, eq=False)
class TileTask:
    """One tile's work.

    Attributes:
        window: points of the tile and its halo, upright, the tile's middle at the origin; colours or none.
        half_m: (3,) half the tile's edges: what lies within is the tile's own.
        seed: everything random about this tile.
        runs: how often the completer is asked.
    """

    window: PointCloud
    half_m: NDArray[np.float64]
    seed: tuple[int, ...]
    runs: int


@dataclass(frozen=True, eq=False)
class TileResult:
    """What came of a tile, in the task's frame.

    Attributes:
        points: (A, 3) what is new, at the density around it.
        colors: (A, 3) or None.
        spacing_m: (A,) how far they are apart, as on a square grid.
        parents: (A, P) rows of the proposals that each point's colour and confidence come from.
        weights: (A, P) their shares, each row sums to 1.
        proposals: (K, 3) what the completer proposed that is new, as coarse as it worked.
        evidence: (K, 3) the factors of distance, agreement and enclosure.
        own: (K,) the completer's own confidence, 1 where it has none.
        seconded: (K,) how many of the other runs put a point there too.
        asked: how many other runs there were.
        working_m: spacing of the cloud that the completer was given.
        gaps: (G, 3) places in gaps that nobody filled, half a spacing apart.
        gaps_m2: (G,) the area of gap that each stands for.
        surface_m2: of what was observed in the tile itself.
    """

    points: NDArray[np.float64]
    colors: NDArray[np.float32] | None
    spacing_m: NDArray[np.float64]
    parents: NDArray[np.int64]
    weights: NDArray[np.float64]
    proposals: NDArray[np.float64]
    evidence: NDArray[np.float64]
    own: NDArray[np.float64]
    seconded: NDArray[np.int64]
    asked: int
    working_m: float
    gaps: NDArray[np.float64]
    gaps_m2: NDArray[np.float64]
    surface_m2: float


def tile_result(task: TileTask, completer: Completer) -> TileResult | None:
    """Complete a tile; None where it holds too few points to know a surface. Repeated points count once.

    Whatever the completer raises passes through.
    """
    window = task.window
    again = repeats(window.points)
    if again.any():
        window = window.select(~again)
    if len(window) < FEWEST_POINTS:
        return None
    rng = np.random.default_rng(seed_from("complete", *task.seed))
    everything = cKDTree(window.points)
    working = window.select(_working_rows(window.points, rng))
    tree = cKDTree(working.points)
    working_spacing = spacing_at(working.points, tree)
    typical = float(np.median(working_spacing))
    if typical == 0:
        return None

    answers = [_new_points(completer, working, tree, working_spacing, task.seed, run) for run in range(task.runs)]
    new, certainty = answers[0]
    seconded = np.zeros(len(new), np.int64)
    for other, _ in answers[1:]:
        if len(other) and len(new):
            gap, _ = cKDTree(other.points).query(new.points, workers=thread_count())
            seconded += gap <= AGREES_WITHIN * typical

    union = np.concatenate([working.points, new.points])
    normals, _ = local_planes(union)
    count = len(working)
    full_spacing = spacing_inside(working.points, tree, everything)
    # The lowest points of a cloud lie on the sides of their tiles.
    own = (np.abs(working.points) <= task.half_m + 1e-6).all(axis=1)
    gaps, gaps_m2 = open_gaps(union, normals, spacing_at(union, cKDTree(union)), working.points)
    nearest = _nearest(tree, new.points, 8)
    wanted = np.median(full_spacing[nearest], axis=1)
    wanted = np.maximum(wanted, DENSEST * float(np.median(full_spacing)))
    given = np.full(len(new), typical)
    if len(new):
        new_tree = cKDTree(new.points)
        given = np.clip(spacing_inside(new.points, new_tree, new_tree), 0.5 * typical, typical)
    # What lies farther out is another tile's to fill up.
    mine = np.flatnonzero((np.abs(new.points) < task.half_m + 2 * typical).all(axis=1))
    points, spacing = at_density(new.points[mine], normals[count:][mine], given[mine], wanted[mine], everything, rng)
    parents, weights = _parents(points, new.points, typical)
    return TileResult(
        points=points,
        colors=_colors(points, parents, weights, new, working),
        spacing_m=spacing,
        parents=parents,
        weights=weights,
        proposals=new.points,
        evidence=evidence(new.points, normals[count:], working.points, normals[:count], typical, rng),
        own=certainty,
        seconded=seconded,
        asked=task.runs - 1,
        working_m=typical,
        gaps=gaps,
        gaps_m2=gaps_m2,
        surface_m2=float((spacing_inside(working.points, tree, tree)[own] ** 2).sum()),
    )


def observed_alone(task: TileTask) -> TileResult | None:
    """The result of a completer that adds nothing: a tile's area, and its gaps, all open."""
    return tile_result(replace(task, runs=1), _Idle())


class _Idle(Completer):
    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        return cloud


def _working_rows(points: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.int64]:
    """The rows that the completer gets: evenly spaced, no finer than 4 cm and no more than it is made for."""
    rows = np.arange(len(points))
    if len(points) > MOST_TO_THIN:
        rows = np.sort(rng.choice(len(points), MOST_TO_THIN, replace=False))
    cells = np.floor((points[rows] - points.min(axis=0)) / FINEST_SPACING_M).astype(np.int64)
    _, of_cell = np.unique((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2], return_counts=True)
    alone = int((of_cell == 1).sum())
    # A densely sampled surface fills about 1.5 voxels for each square of their edge (random orientation).
    count = min(WORKING_POINTS, alone + round((len(of_cell) - alone) / 1.5))
    if len(points) <= min(1.2 * count, WORKING_POINTS):
        return rows
    return rows[poisson_disk_indices(points[rows], count, rng)]


def _new_points(
    completer: Completer,
    working: PointCloud,
    tree: cKDTree,
    working_spacing: NDArray[np.float64],
    seed: tuple[int, ...],
    run: int,
) -> tuple[PointCloud, NDArray[np.float64]]:
    """What the completer adds where nothing was observed, about a spacing from every observed point, and how sure."""
    rng = np.random.default_rng(seed_from("complete", *seed, "run", run))
    completed, given = completer.complete_with_confidence(working, rng)
    if not isinstance(completed, PointCloud):
        raise PluginError(f"its complete() returned {type(completed).__name__}, not a PointCloud")
    own = _own_confidence(given, len(completed))
    # Whoever keeps the input says himself what is new; who makes all points anew puts them between the old ones.
    count = len(working)
    # Programs are given float32 in many formats, and give that back.
    first = completed.points[:count]
    keeps = len(first) == count and np.allclose(first, working.points, rtol=0, atol=LARGEST_FLOAT32_ERROR_M)
    beyond = RADIUS_OF_SPACING if keeps else NEW_BEYOND
    low, high = working.points.min(axis=0), working.points.max(axis=0)
    margin = 0.1 * float((high - low).max())
    inside = ((completed.points >= low - margin) & (completed.points <= high + margin)).all(axis=1)
    completed, own = completed.select(inside), own[inside]
    if not len(completed):
        return completed, own
    gap, nearest = tree.query(completed.points, workers=thread_count())
    new = gap > beyond * working_spacing[nearest]
    return completed.select(new), own[new]


def _own_confidence(given: NDArray[np.floating[Any]] | None, count: int) -> NDArray[np.float64]:
    """(N,) what a completer says of its points; 1 of each where it says nothing."""
    if given is None:
        return np.ones(count)
    try:
        own = np.asarray(given, np.float64)
    except (TypeError, ValueError) as error:
        raise PluginError(f"its confidence is not numbers ({error}); one a point is wanted, ({count},)") from None
    if own.shape != (count,):
        raise PluginError(f"its confidence has shape {own.shape}; one number a point is wanted, ({count},)")
    if not ((own >= 0) & (own <= 1)).all():
        raise PluginError("its confidence must lie in [0, 1] at every point")
    return own


def _nearest(tree: cKDTree, places: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """(M, k) rows of the points nearest to (M, 3) places; k is `count`, or all there are."""
    k = min(count, tree.n)
    _, index = tree.query(places, k=k, workers=thread_count())
    rows: NDArray[np.int64] = index.reshape(len(places), k)
    return rows


def _parents(
    points: NDArray[np.float64], proposals: NDArray[np.float64], scale_m: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """(A, P) the nearest proposals of each point, and (A, P) weights by inverse square distance."""
    if not len(points):
        return np.empty((0, 1), np.int64), np.empty((0, 1))
    k = min(INTERPOLATED, len(proposals))
    gaps, index = cKDTree(proposals).query(points, k=k, workers=thread_count())
    weights = 1.0 / ((gaps.reshape(-1, k) / scale_m) ** 2 + 0.01)
    return index.reshape(-1, k), weights / weights.sum(axis=1, keepdims=True)


def _colors(
    points: NDArray[np.float64],
    parents: NDArray[np.int64],
    weights: NDArray[np.float64],
    new: PointCloud,
    working: PointCloud,
) -> NDArray[np.float32] | None:
    """(A, 3) the proposals' colours, or, from a completer that gives none, those of the nearest observed points."""
    if working.colors is None:
        return None
    colors = new.colors
    if colors is None or not len(new):
        parents, weights = _parents(points, working.points, 1.0)
        colors = working.colors
    mixed = np.einsum("ap,apc->ac", weights, colors[parents])
    return np.clip(mixed, 0.0, 1.0).astype(np.float32)
