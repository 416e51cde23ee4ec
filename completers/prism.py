"""The upright prism around what was observed: rooms fill theirs, and scans say little of what lies beyond."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

FEWEST = 4  # points of a cell; those of emptier ones are strays
BEYOND = 1.0  # spacings outside of the prism around what was observed, from which on completers add nothing


@dataclass(frozen=True, eq=False)
class Prism:
    """The convex hull of a plan, from the lowest to the highest point; strays are left out.

    Attributes:
        sides: (F, 3) outward normal (2) and offset of each side: `normal . xy + offset` is 0 on it, metres.
        low: z of the bottom, metres.
        high: z of the top.
    """

    sides: NDArray[np.float64]
    low: float
    high: float

    @staticmethod
    def around(points: NDArray[np.float64], cell_m: float) -> Prism:
        """That of (N, 3) points, metres, without those that share a cell of this edge with fewer than three others."""
        cells = np.floor((points - points.min(axis=0)) / cell_m).astype(np.int64)
        _, across, up = cells.max(axis=0) + 1
        cell = (cells[:, 0] * across + cells[:, 1]) * up + cells[:, 2]
        _, of, count = np.unique(cell, return_inverse=True, return_counts=True)
        many = count[of] >= FEWEST
        points = points[many] if many.any() else points
        plan = points[:, :2]
        try:
            sides = ConvexHull(plan).equations
        except QhullError:
            # All in one line: the rectangle along it.
            _, axes = np.linalg.eigh(np.cov(plan, rowvar=False, ddof=0))
            normals = np.concatenate([axes.T, -axes.T])
            sides = np.column_stack([normals, -(plan @ normals.T).max(axis=0)])
        return Prism(sides, float(points[:, 2].min()), float(points[:, 2].max()))

    def side_depth(self, plan: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) metres from (N, 2) places in the plan to the nearest side, negative outside."""
        depth = np.full(len(plan), np.inf)
        # Side by side: all at once would take memory for each side.
        for x, y, offset in self.sides:
            np.minimum(depth, -(x * plan[:, 0] + y * plan[:, 1] + offset), out=depth)
        return depth

    def misses(self, low: NDArray[np.float64], high: NDArray[np.float64], by_m: float) -> bool:
        """Whether all of the box from corner (3,) to corner (3,) lies at least so far outside, by one face alone."""
        normals, offsets = self.sides[:, :2], self.sides[:, 2]
        nearest = np.minimum(normals * low[:2], normals * high[:2]).sum(axis=1) + offsets
        return bool(max(nearest.max(), low[2] - self.high, self.low - high[2]) >= by_m)

    def depth(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) metres from (N, 3) points to the nearest face, negative outside."""
        ends = np.minimum(points[:, 2] - self.low, self.high - points[:, 2])
        return np.minimum(self.side_depth(points[:, :2]), ends)
