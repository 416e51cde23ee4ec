"""Tiles: a cloud cut in x-y (tall buildings in z too), each tile with a halo of its neighbours' points."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pcdbench.errors import PcdbenchError
from pcdbench.geometry.frames import Frame
from pcdbench.geometry.neighbors import median_spacing

# With 1 m, a hole of 1.4 m radius on a corner of four tiles got a fifth of what one piece puts there; with 1.5 m, all.
HALO_M = 1.5
WORKING_POINTS = 30_000
FINEST_SPACING_M = 0.04
PLANNED_SPACING_M = 0.08
SMALLEST_TILE_M = 4.0
LARGEST_TILE_M = 12.0
# Rooms and halls stay whole; what is taller is cut by storeys' height.
TALLEST_ROOM_M = 9.0
STOREYS_M = 6.0
# Halo and tile in spacings, where a cloud is so coarse (or its unit so wrong) that metres are too few.
_HALO_SPACINGS, _LARGEST_SPACINGS = 8.0, 120.0
# With fewer points, or where they are farther apart, surfaces of a room are not told from each other.
_FEWEST, _COARSEST_M = 500, 0.25
_NEIGHBOR_POINTS = 100_000
_PLAN_POINTS = 2_000_000
_PLAN_CELL_M = 1.0

Index = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Tiling:
    """A cloud's points by tile.

    Attributes:
        points: (N, 3) the cloud, in its own frame.
        frame: makes it upright.
        origin: (3,) the upright cloud's lowest corner: the corner of tile (0, 0, 0).
        edges_m: (3,) edges of a tile.
        halo_m: how far a tile's window reaches into its neighbours.
    """

    points: NDArray[np.float64]
    frame: Frame
    origin: NDArray[np.float64]
    edges_m: NDArray[np.float64]
    halo_m: float
    _order: NDArray[np.int64]
    _span_of_tile: dict[Index, tuple[int, int]]

    @classmethod
    def of(cls, points: NDArray[np.float64], frame: Frame, edge_m: float | None) -> Tiling:
        """Cut (N, 3) `points` into tiles of `edge_m`, or of an edge that their density decides.

        Raises:
            PcdbenchError: for an edge smaller than twice the halo, or none.
        """
        spacing = typical_spacing(points)
        halo_m = max(HALO_M, _HALO_SPACINGS * spacing)
        if edge_m is not None and not 2 * halo_m <= edge_m < np.inf:
            wrong = "too small" if edge_m < 2 * halo_m else "no size"
            raise PcdbenchError(f"tiles of {edge_m:g} m are {wrong}; take at least {2 * halo_m:.3g} m (--tile-m)")
        axes = [frame.column(points, axis) for axis in range(3)]
        origin = np.array([axis.min() for axis in axes])
        height = float(axes[2].max() - origin[2])
        if edge_m is None:
            edge_m = _edge_by_density(frame.upright(_some(points)) - origin, spacing, halo_m)
        tall = height > max(TALLEST_ROOM_M, 4 * halo_m)
        edges = np.array([edge_m, edge_m, max(STOREYS_M, 2 * halo_m) if tall else 2 * height + 1.0])
        numbers, shape = np.zeros(len(points), np.int64), []
        for axis, low, edge in zip(axes, origin, edges, strict=True):
            cells = ((axis - low) / edge).astype(np.int64)
            shape.append(int(cells.max()) + 1)
            numbers = numbers * shape[-1] + cells
        del axes, cells
        order = np.argsort(numbers, kind="stable")
        found, starts = np.unique(numbers[order], return_index=True)
        ends = np.append(starts[1:], len(points))
        indices = np.stack(np.unravel_index(found, shape), axis=1).tolist()
        spans = {(i, j, k): (int(start), int(end)) for (i, j, k), start, end in zip(indices, starts, ends, strict=True)}
        return cls(points, frame, origin, edges, halo_m, order, spans)

    @property
    def tiles(self) -> list[Index]:
        """The tiles that hold points, in order."""
        return list(self._span_of_tile)

    def count(self, tile: Index) -> int:
        """How many points a tile itself holds."""
        start, end = self._span_of_tile[tile]
        return end - start

    def center(self, tile: Index) -> NDArray[np.float64]:
        """(3,) the middle of a tile, upright."""
        return self.origin + (np.array(tile) + 0.5) * self.edges_m

    def window(self, tile: Index) -> NDArray[np.int64]:
        """Rows of the points in a tile and its halo."""
        rows = []
        for other in (tile, *self.neighbors(tile)):
            start, end = self._span_of_tile[other]
            found = self._order[start:end]
            if other != tile:
                found = found[self.covers(tile, self.frame.upright(self.points[found]))]
            rows.append(found)
        return np.concatenate(rows)

    def owned(self, tile: Index, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(M,) which of the upright (M, 3) places are the tile's own.

        A place outside of all tiles that hold points belongs to the nearest of them: what a completer puts a hair
        below the lowest point of a floor is the tile's above it.
        """
        indices = np.floor((places - self.origin) / self.edges_m).astype(np.int64)
        own = np.asarray((indices == tile).all(axis=1), np.bool_)
        for index in np.unique(indices[~own], axis=0).tolist():
            place: Index = (index[0], index[1], index[2])
            if place in self._span_of_tile:
                continue
            around = self.neighbors(place)
            if tile in around:
                rows = np.flatnonzero((indices == index).all(axis=1))
                away = np.stack([self._away_m(other, places[rows]) for other in around])
                own[rows] = away.argmin(axis=0) == around.index(tile)
        return own

    def _away_m(self, tile: Index, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """(M,) metres from the upright (M, 3) places to a tile; 0 within."""
        beyond = np.abs(places - self.center(tile)) - self.edges_m / 2
        away: NDArray[np.float64] = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        return away

    def covers(self, tile: Index, places: NDArray[np.float64], margin_m: float = 0.0) -> NDArray[np.bool_]:
        """(M,) which of the upright (M, 3) places lie in a tile's window, at least `margin_m` from its sides."""
        reach = self.edges_m / 2 + self.halo_m - margin_m
        return np.asarray((np.abs(places - self.center(tile)) < reach).all(axis=1), np.bool_)

    def neighbors(self, tile: Index) -> list[Index]:
        """The up to 26 tiles around one that hold points."""
        around = ((tile[0] + i, tile[1] + j, tile[2] + k) for i, j, k in product((-1, 0, 1), repeat=3))
        return [other for other in around if other != tile and other in self._span_of_tile]

    def name(self, tile: Index) -> str:
        """Where a tile is, for messages, in the cloud's own coordinates."""
        corners = self.center(tile) + np.array([[-0.5], [0.5]]) * self.edges_m
        # Signs may exchange the corners, and make zeros negative.
        low, high = np.sort(np.round(self.frame.back(corners), 1), axis=0) + 0.0
        axes = sorted(self.frame.axes[: 3 if tile[2] else 2])
        return "tile " + ", ".join(f"{'xyz'[axis]} {low[axis]:.1f} to {high[axis]:.1f} m" for axis in axes)


def typical_spacing(points: NDArray[np.float64]) -> float:
    """Median distance (metres) between neighbours, measured among a hundred thousand points that lie together."""
    if len(points) <= _NEIGHBOR_POINTS:
        return median_spacing(points)
    distance = np.abs(points[:, 0] - points[len(points) // 2, 0])
    for axis in (1, 2):
        np.maximum(distance, np.abs(points[:, axis] - points[len(points) // 2, axis]), out=distance)
    return median_spacing(points[np.argpartition(distance, _NEIGHBOR_POINTS)[:_NEIGHBOR_POINTS]])


def too_thin(points: NDArray[np.float64]) -> str | None:
    """One line where points are so few or so far apart that they hardly show a surface, and None where they do."""
    spacing = typical_spacing(points)
    if len(points) >= _FEWEST and spacing <= _COARSEST_M:
        return None
    return (
        f"its {len(points):,} points, {spacing:,.2f} m apart, hardly show a surface; are they too few, or is its unit "
        "not metres?"
    )


def _some(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """At most two million of the points: enough to know where surfaces are."""
    return points[:: -(-len(points) // _PLAN_POINTS)]


def _edge_by_density(points: NDArray[np.float64], spacing_m: float, halo_m: float) -> float:
    """The edge at which a window holds about as many points, thinned to 8 cm, as completers are made for.

    Args:
        points: (N, 3) upright, the lowest corner at the origin.
    """
    edge = max(PLANNED_SPACING_M, spacing_m)
    cells = np.unique(np.floor(points / edge).astype(np.int64), axis=0)
    largest = max(LARGEST_TILE_M, _LARGEST_SPACINGS * spacing_m)
    # What a window may hold needs no halo; an edge by its density would count one.
    if len(cells) <= WORKING_POINTS and float(points[:, :2].max()) < largest:
        return largest
    plan_m = max(_PLAN_CELL_M, 10 * edge)
    _, of_cell = np.unique((cells[:, :2] * edge) // plan_m, axis=0, return_counts=True)
    per_m2 = float(np.percentile(of_cell, 75)) / plan_m**2
    return float(np.clip((WORKING_POINTS / per_m2) ** 0.5 - 2 * halo_m, max(SMALLEST_TILE_M, 2 * halo_m), largest))
