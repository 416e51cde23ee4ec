"""What the networks' PConv layers look at: sampled points of each patch and the neighbours of each of them.

They depend on the points alone, so loader workers prepare them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..patch_neighbors import within

RADII = (0.15, 0.3)  # of the patch
NEIGHBORS = 32


@dataclass(frozen=True, eq=False)
class Neighborhoods:
    """The two levels of sampling of P patches of N points.

    Attributes:
        sampled_1: (P, N / 4) rows of a patch's points, farthest first.
        neighbors_1: (P, N / 4, 32) the nearest rows within 0.15 of each; the point itself where there are fewer.
        sampled_2: (P, N / 8) rows of the points sampled first.
        neighbors_2: (P, N / 8, 32) likewise, within 0.3.
    """

    sampled_1: NDArray[np.int32]
    neighbors_1: NDArray[np.int32]
    sampled_2: NDArray[np.int32]
    neighbors_2: NDArray[np.int32]

    @staticmethod
    def of(points: NDArray[np.float32]) -> Neighborhoods:
        """Those of (P, N, 3) points, each patch scaled to [0, 1]."""
        count = points.shape[1]
        sampled_1 = farthest(points, count // 4)
        # Farthest points come in order, so that the first of them are the farthest of them all, too.
        sampled_2 = np.tile(np.arange(count // 8, dtype=np.int32), (len(points), 1))
        middle = np.take_along_axis(points, sampled_1[..., None], axis=1)
        return Neighborhoods(
            sampled_1,
            within(points, sampled_1, RADII[0], NEIGHBORS),
            sampled_2,
            within(middle, sampled_2, RADII[1], NEIGHBORS),
        )


def farthest(points: NDArray[np.float32], count: int) -> NDArray[np.int32]:
    """(P, count) rows of (P, N, 3) points: in each patch, the point farthest from those before it, again and again.

    The first is the farthest from the patch's mean, so that the order of the points does not matter. All patches go
    together: that is twice as fast as fpsample's exact sampling one by one (its bucketed ones are not exact).
    """
    axes = np.moveaxis(points, 2, 0).copy()
    patch = np.arange(len(points))
    latest = np.square(points - points.mean(axis=1, keepdims=True, dtype=np.float64)).sum(axis=2).argmax(axis=1)
    chosen = np.empty((len(points), count), dtype=np.int32)
    apart = np.full(points.shape[:2], np.inf, dtype=np.float32)
    for at in range(count):
        chosen[:, at] = latest
        dx, dy, dz = axes - axes[:, patch, latest][..., None]
        np.minimum(apart, dx * dx + dy * dy + dz * dz, out=apart)
        latest = apart.argmax(axis=1)
    return chosen
