"""The graph that FoldingNet's encoder looks at; it depends on the points alone, so loader workers prepare it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..patch_neighbors import within

NEIGHBORS = 16
_FARTHER_THAN_A_PATCH = 3.0


def nearest_16(points: NDArray[np.float32]) -> NDArray[np.int32]:
    """(P, N, 16) rows of the points nearest to each of (P, N, 3), itself among them."""
    every = np.tile(np.arange(points.shape[1], dtype=np.int32), (len(points), 1))
    return within(points, every, _FARTHER_THAN_A_PATCH, NEIGHBORS)
