"""The regions of a building that should be scanned again: where completion guessed, and where gaps stayed open."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pcdbench.completion.completed import Completed
from pcdbench.completion.confidence import FACTORS

DOUBTFUL = 0.4
SMALLEST_M2 = 0.5
# What one stands before and scans again.
LARGEST_M = 2.2
SMALLEST_PIECE_M2 = 0.25
CELL_M = 0.3
# Middles of cubes that touch, if only at a corner, are at most the square root of 3 edges apart; others are 2.
TOUCHING_EDGES = 1.8
_REASON_OF_FACTOR = {
    "distance": "added far from anything observed",
    "agreement": "what was added does not continue the surfaces around it",
    "enclosure": "added beyond the edge of what was observed",
    "opinions": "tiles or runs of the completer disagree about it",
    "completer": "the completer itself is unsure of it",
}
OPEN = "a gap in a surface that the completer left open"


@dataclass(frozen=True)
class Region:
    """A place to scan again.

    Attributes:
        number: 1 is the largest.
        reason: why.
        center_m: the middle of its box, in the cloud's own frame, as all of these.
        size_m: its extent along x, y and z.
        area_m2: of the surface that was guessed or is missing, about.
        share: that area in shares of all surface, observed and added.
        confidence: median of the added points, or None where nothing was added.
        low_m, high_m: lowest and highest corner of its box.
    """

    number: int
    reason: str
    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    area_m2: float
    share: float
    confidence: float | None
    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]

    def as_json(self) -> dict[str, Any]:
        """The region for `report.json`."""
        return asdict(self)


def regions_to_scan(completed: Completed) -> list[Region]:
    """Clusters of added points below a confidence of 0.4, and of open gaps, of 0.5 m2 and more, largest first.

    Points belong together where the cubes of 0.3 m that they fill touch. Clusters longer than 2.2 m are cut; their
    pieces are regions of their own if they have 0.25 m2.
    """
    first = len(completed.cloud) - len(completed.spacing_m)
    trust = completed.confidence[first:]
    doubtful = np.flatnonzero(trust < DOUBTFUL)
    added = completed.cloud.points[first:][doubtful]
    total = completed.surface_m2 + float((completed.spacing_m**2).sum())
    found: list[tuple[float, str, NDArray[np.float64], float | None]] = []
    for members, area in _pieces(added, completed.spacing_m[doubtful] ** 2):
        weakest = np.bincount(completed.weakest[doubtful[members]], minlength=len(FACTORS)).argmax()
        median = float(np.median(trust[doubtful[members]]))
        found.append((area, _REASON_OF_FACTOR[FACTORS[weakest]], added[members], median))
    found += [
        (area, OPEN, completed.gaps[members], None) for members, area in _pieces(completed.gaps, completed.gaps_m2)
    ]
    regions = []
    for number, (area, reason, points, median_trust) in enumerate(sorted(found, key=lambda entry: -entry[0]), start=1):
        low, high = points.min(axis=0), points.max(axis=0)
        regions.append(
            Region(
                number=number,
                reason=reason,
                center_m=_rounded((low + high) / 2),
                size_m=_rounded(high - low),
                area_m2=round(area, 2),
                share=round(area / total, 5),
                confidence=None if median_trust is None else round(median_trust, 3),
                low_m=_rounded(low),
                high_m=_rounded(high),
            )
        )
    return regions


def _rounded(values: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = np.round(values, 2).tolist()
    return x, y, z


def _pieces(points: NDArray[np.float64], areas_m2: NDArray[np.float64]) -> list[tuple[NDArray[np.int64], float]]:
    """The rows of each cluster of (N, 3) points that is large enough, or of each piece of it, and its square metres."""
    pieces = []
    for members in _clusters(points):
        whole = float(areas_m2[members].sum())
        if whole < SMALLEST_M2:
            continue
        for rows in _cut(points, members):
            area = float(areas_m2[rows].sum())
            if area >= SMALLEST_PIECE_M2:
                pieces.append((rows, area))
    return pieces


def _cut(points: NDArray[np.float64], rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """The rows in pieces no longer than 2.2 m along any axis, cut into equal lengths along the longest one first."""
    low, sides = points[rows].min(axis=0), np.ptp(points[rows], axis=0)
    axis = int(sides.argmax())
    if sides[axis] <= LARGEST_M:
        return [rows]
    count = int(np.ceil(sides[axis] / LARGEST_M))
    piece = np.minimum((points[rows, axis] - low[axis]) * (count / sides[axis]), count - 1).astype(np.int64)
    return [whole for number in np.unique(piece) for whole in _cut(points, rows[piece == number])]


def _clusters(points: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """The rows of each cluster of (N, 3) points."""
    if not len(points):
        return []
    cells, cell = np.unique(np.floor((points - points.min(axis=0)) / CELL_M), axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(TOUCHING_EDGES, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(len(cells), len(cells)))
    _, label = connected_components(links, directed=False)
    of_point = label[cell.ravel()]
    order = np.argsort(of_point, kind="stable")
    starts = np.flatnonzero(np.diff(of_point[order], prepend=-1))
    return np.split(order, starts[1:])
