"""Subsets of a cloud: blue noise (Poisson disk) of an exact size, or of a given radius around fixed points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.geometry.neighbors import loose_tree
from pcdbench.threads import thread_count

CANDIDATES_PER_VOXEL = 6
RADIUS_STEP = 0.95
MAX_STEPS = 60


def poisson_disk_indices(
    points: NDArray[np.float64],
    count: int,
    rng: np.random.Generator | None = None,
    order: NDArray[np.int64] | None = None,
) -> NDArray[np.int64]:
    """(count,) sorted rows of `points`: a subset spaced evenly, whatever the density of the source.

    Dart throwing with random priorities: a point is taken if no point of higher priority lies within the
    radius. The radius starts larger than what fits and shrinks by 5 % a pass, until exactly `count` points
    are taken; so the smallest distance between them is the last radius (0 only where the source holds too few
    points apart from each other, and the rest is filled up at random). Isolated points are always taken.

    Args:
        points: (N, 3) metres.
        count: how many to take; all rows are returned where it is N or more.
        rng: decides the priorities.
        order: or (N,) the rows, that of highest priority first.

    Raises:
        ValueError: where neither is given and there is a choice.
    """
    total = len(points)
    if count >= total:
        return np.arange(total, dtype=np.int64)
    if count <= 0:
        return np.empty(0, np.int64)
    centered = np.asarray(points, np.float64) - points.min(axis=0)
    if order is None:
        if rng is None:
            raise ValueError("poisson_disk_indices needs rng or order, to know who comes first")
        order = rng.permutation(total)
    edge, voxels = _voxels_for(centered, count)
    candidates = _first_per_voxel(voxels, order, CANDIDATES_PER_VOXEL)
    radius = 0.9 * edge
    taken = _dart_throwing(centered[candidates], count, radius)
    chosen = candidates[taken]
    if len(chosen) < count:
        free = np.ones(total, np.bool_)
        free[chosen] = False
        rest = order[free[order]]
        chosen = np.concatenate([chosen, rest[: count - len(chosen)]])
    return np.sort(chosen).astype(np.int64)


def own_numbers(points: NDArray) -> NDArray[np.uint64]:
    """(N,) a random-looking number of each of (N, 3) points, decided by its float32 coordinates alone.

    Drawn in their order, two clouds that differ in a few points give samples that differ in a few.
    """
    bits = np.ascontiguousarray(np.asarray(points, np.float32) + np.float32(0)).view(np.uint32).astype(np.uint64)
    mixed = np.zeros(len(bits), np.uint64)
    for column in bits.T:
        # The finalizer of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): it spreads every bit over all.
        mixed = (mixed ^ column) + np.uint64(0x9E3779B97F4A7C15)
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed ^= mixed >> np.uint64(31)
    return mixed


def apart_indices(
    points: NDArray[np.float64],
    radius: float,
    rng: np.random.Generator,
    fixed: int = 0,
    tree: cKDTree | None = None,
) -> NDArray[np.int64]:
    """(M,) sorted rows of `points`, no two of which are nearer than `radius`, and to which no other row can be added.

    Dart throwing with random priorities around points that are there already.

    Args:
        points: (N, 3) metres; near the origin where there is a tree.
        radius: metres.
        rng: decides the priorities.
        fixed: the first so many rows are taken in any case, however near they are to each other.
        tree: of these, where there is one already.
    """
    free = fixed + rng.permutation(len(points) - fixed)
    if not len(free):
        return np.arange(len(points), dtype=np.int64)
    centered = points if tree is not None else np.asarray(points, np.float64) - points.mean(axis=0)
    apart = np.ones(len(points), np.bool_)
    if fixed:
        # All at once: in their own order neighbours mostly follow each other, which trees answer faster.
        known = loose_tree(centered[:fixed]) if tree is None else tree
        nearest, _ = known.query(centered[fixed:], distance_upper_bound=radius, workers=thread_count())
        apart[fixed:] = nearest >= radius
    taken = np.empty(0, np.int64)
    # In order of priority, a part at a time: most of the later ones are too near to what the first have taken.
    for some in np.split(free, [len(free) // 8, len(free) // 3]):
        some = some[apart[some]]
        if len(taken):
            nearest, _ = loose_tree(centered[taken]).query(
                centered[some], distance_upper_bound=radius, workers=thread_count()
            )
            some = some[nearest >= radius]
        winner, loser = _pairs(centered[some], radius)
        taken = np.concatenate([taken, some[_greedy(winner, loser, np.zeros(len(some), np.bool_))]])
    return np.concatenate([np.arange(fixed, dtype=np.int64), np.sort(taken)])


def _dart_throwing(points: NDArray[np.float64], count: int, radius: float) -> NDArray[np.int64]:
    """At most `count` rows of `points`, whose order is their priority, by radii shrinking from `radius`."""
    # Rows are in order of priority, so the first of a pair wins over the second.
    winner, loser = _pairs(points, radius)
    dx, dy, dz = (axis[winner] - axis[loser] for axis in np.ascontiguousarray(points.T))
    apart = np.sqrt(dx * dx + dy * dy + dz * dz)
    taken = np.zeros(len(points), np.bool_)
    for _ in range(MAX_STEPS):
        close = apart <= radius
        winner, loser, apart = winner[close], loser[close], apart[close]
        added = _greedy(winner, loser, taken)
        if taken.sum() + len(added) >= count:
            return np.concatenate([np.flatnonzero(taken), added[: count - int(taken.sum())]])
        taken[added] = True
        radius *= RADIUS_STEP
    return np.flatnonzero(taken)


def _pairs(points: NDArray[np.float64], radius: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The pairs of rows no farther apart than `radius`: the lower rows, and the higher ones."""
    if not len(points):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    lower, higher = loose_tree(points).query_pairs(radius, output_type="ndarray").T
    return np.ascontiguousarray(lower), np.ascontiguousarray(higher)


def _greedy(winner: NDArray[np.int64], loser: NDArray[np.int64], taken: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Rows to add to `taken` so that no pair holds two of them: what going through all rows in order would add."""
    open_ = ~taken
    open_[loser[taken[winner]]] = False
    open_[winner[taken[loser]]] = False
    added = []
    while open_.any():
        alive = open_[winner] & open_[loser]
        winner, loser = winner[alive], loser[alive]
        best = open_.copy()
        best[loser] = False
        added.append(np.flatnonzero(best))
        open_ &= ~best
        open_[loser[best[winner]]] = False
    return np.sort(np.concatenate(added)) if added else np.empty(0, np.int64)


def _voxels_for(points: NDArray[np.float64], count: int) -> tuple[float, NDArray[np.int64]]:
    """An edge (metres) at which the points fill about `count` voxels, and each point's voxel number."""
    extent = float(np.ptp(points, axis=0).max())
    if extent == 0.0:
        return 0.0, np.zeros(len(points), np.int64)
    edge = extent / max(1.0, np.sqrt(count / 4))
    for _ in range(8):
        voxels = _voxel_numbers(points, edge)
        filled = _distinct(voxels)
        if abs(filled - count) <= 0.1 * count:
            break
        # Surfaces: the number of filled voxels goes with the edge's inverse square.
        edge *= float(np.clip(np.sqrt(filled / count), 0.25, 4.0))
    return edge, voxels


def _voxel_numbers(points: NDArray[np.float64], edge: float) -> NDArray[np.int64]:
    x, y, z = np.minimum(points.T / edge, 2.0**20).astype(np.int64)
    bits = int(max(x.max(), y.max(), z.max())).bit_length()
    return (x << 2 * bits) | (y << bits) | z


def stable_order(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """What `numpy.argsort(numbers, kind="stable")` gives for numbers from 0 up, ten times faster if not huge."""
    order, _ = _ordered(numbers)
    return order


def first_of_each(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sorted rows at which a number (0 or more) appears for the first time."""
    order, grouped = _ordered(numbers)
    new = np.ones(len(order), np.bool_)
    np.not_equal(grouped[1:], grouped[:-1], out=new[1:])
    return np.sort(order[new])


def _ordered(numbers: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows of numbers from 0 up in stable order, and the numbers in that order.

    Number and row are sorted as one word, where 63 bits hold both.
    """
    bits = len(numbers).bit_length()
    if not len(numbers) or int(numbers.max()).bit_length() + bits > 63:
        order = np.argsort(numbers, kind="stable")
        return order, numbers[order]
    words = numbers << bits
    words |= np.arange(len(numbers))
    words.sort()
    return words & ((1 << bits) - 1), words >> bits


def _distinct(numbers: NDArray[np.int64]) -> int:
    ordered = np.sort(numbers)
    return int((ordered[1:] != ordered[:-1]).sum()) + 1


def _first_per_voxel(voxels: NDArray[np.int64], order: NDArray[np.int64], at_most: int) -> NDArray[np.int64]:
    """The first `at_most` rows of each voxel in `order`, in that order."""
    by_voxel, grouped = _ordered(voxels[order])
    starts = np.flatnonzero(np.concatenate([[True], grouped[1:] != grouped[:-1]]))
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.append(starts, len(order))))
    return order[np.sort(by_voxel[rank < at_most])]
