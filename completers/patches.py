"""Clouds cut into patches as DeepPCD cuts them: a grid over length and width, every patch a cloud of its own scale."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

POINTS = 1024  # a patch
OVERLAP = 0.01  # of a cell, on each side
FEWEST_OF_20000 = 100  # a patch with no more points says too little (of a cloud of 20,000; of fewer, as many fewer)
FEWEST = 4


@dataclass(frozen=True, eq=False)
class Grid:
    """The cloud scaled to [0, 1] with its aspect kept, and the G x G grid over its length and width.

    Attributes:
        low: (3,) metres: the cloud's lowest corner.
        side_m: its longest side, metres: what is 1 afterwards.
        extent: (3,) length, width and height in units of that side.
        size: G.
    """

    low: NDArray[np.float64]
    side_m: float
    extent: NDArray[np.float64]
    size: int

    @staticmethod
    def over(points: NDArray[np.float64], size: int) -> Grid | None:
        """The grid over (N, 3) points in metres; None where they all lie at one place."""
        low = points.min(axis=0)
        extent = points.max(axis=0) - low
        side_m = float(extent.max())
        return Grid(low, side_m, extent / side_m, size) if side_m > 0 else None

    def scaled(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) metres to the unit of the grid."""
        return (points - self.low) / self.side_m

    def metric(self, points: NDArray) -> NDArray[np.float64]:
        """(N, 3) in the unit of the grid back to metres."""
        return points.astype(np.float64) * self.side_m + self.low

    def cells(self) -> NDArray[np.int64]:
        """(G * G, 2): along length and width, in the order of `members`."""
        return np.stack(np.divmod(np.arange(self.size**2), self.size), axis=1)

    def members(self, scaled: NDArray[np.float64]) -> list[NDArray[np.int64]]:
        """The rows of (N, 3) scaled points in each cell; they overlap a little, and border cells reach on beyond."""
        within = []
        for axis in range(2):
            edge = max(self.extent[axis], 1e-9) / self.size
            at = scaled[:, axis] / edge
            low = np.arange(self.size) - OVERLAP
            high = np.arange(self.size) + 1 + OVERLAP
            low[0], high[-1] = -np.inf, np.inf
            within.append((at >= low[:, None]) & (at <= high[:, None]))
        return [np.flatnonzero(within[0][row] & within[1][column]) for row, column in self.cells()]

    def frames(self, cells: NDArray[np.int64]) -> tuple[NDArray[np.float32], np.float32]:
        """Each cell's lowest corner (P, 3), and what is 1 in a patch: the longest side of a cell, room height included.

        A patch is scaled by its cell and not by its points, so that what is missing does not change the scale and
        the neighbour begins where the patch ends.
        """
        edge = self.extent[:2] / self.size
        low = np.zeros((len(cells), 3))
        low[:, :2] = (cells - OVERLAP) * edge
        scale = max(float(((1 + 2 * OVERLAP) * edge).max()), float(self.extent[2]))
        return low.astype(np.float32), np.float32(scale)


@dataclass(frozen=True, eq=False)
class Patches:
    """The patches of a cloud that hold enough points, each resampled to 1024 of them.

    Attributes:
        grid: what they were cut by.
        number: (P,) which of the grid's cells they are.
        rows: (P, 1024) rows of the cloud.
        points: (P, 1024, 3) float32, each patch scaled to [0, 1].
        low: (P, 3) and scale: `low + scale * points` is in the unit of the grid.
    """

    grid: Grid
    number: NDArray[np.int64]
    rows: NDArray[np.int64]
    points: NDArray[np.float32]
    low: NDArray[np.float32]
    scale: np.float32

    @property
    def cells(self) -> NDArray[np.int64]:
        """(P, 2) the position of each patch in the grid."""
        return self.grid.cells()[self.number]

    def select(self, which: NDArray[np.int64]) -> Patches:
        """Some of the patches."""
        return replace(
            self,
            number=self.number[which],
            rows=self.rows[which],
            points=self.points[which],
            low=self.low[which],
        )

    def metric(self, points: NDArray[np.float32]) -> NDArray[np.float64]:
        """(P, K, 3) points of patches, as patches are scaled, to (P * K, 3) metres."""
        return self.grid.metric((self.low[:, None] + self.scale * points).reshape(-1, 3))

    @staticmethod
    def of(points: NDArray[np.float64], size: int, rng: np.random.Generator) -> Patches | None:
        """Cut (N, 3) points, metres, by a `size` x `size` grid; None where no patch holds enough points.

        Args:
            rng: decides which points stand in where a patch has more or fewer than 1024.
        """
        grid = Grid.over(points, size)
        if grid is None:
            return None
        scaled = grid.scaled(points)
        fewest = max(FEWEST, FEWEST_OF_20000 * min(1.0, len(points) / 20_000))
        members = grid.members(scaled)
        number = np.array([at for at, rows in enumerate(members) if len(rows) > fewest], dtype=np.int64)
        if not len(number):
            return None
        rows = np.stack([resampled(members[at], POINTS, rng) for at in number])
        low, scale = grid.frames(grid.cells()[number])
        return Patches(grid, number, rows, ((scaled[rows] - low[:, None]) / scale).astype(np.float32), low, scale)


def resampled(rows: NDArray[np.int64], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """(count,) of the rows: a random subset, or all of them as evenly often as they can be."""
    order = rng.permutation(rows)
    return np.resize(order, count)
