"""Neighbours within patches, one KD-tree for all of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcdbench.geometry.neighbors import loose_tree
from pcdbench.threads import thread_count

_APART = 8.0  # patches are put so far from each other that one KD-tree serves them all


def within(points: NDArray[np.float32], around: NDArray[np.int32], radius: float, at_most: int) -> NDArray[np.int32]:
    """(P, S, at_most) rows of each patch's (P, N, 3) points: the nearest to (P, S) of them within the radius.

    Where there are fewer, the row itself stands in for the rest.

    Args:
        points: each patch scaled to [0, 1].
        radius: less than 1.
    """
    patches, count, _ = points.shape
    apart = points.astype(np.float64)
    apart[..., 0] += _APART * np.arange(patches)[:, None]
    queries = np.take_along_axis(apart, around[..., None].astype(np.int64), axis=1)
    distances, found = loose_tree(apart.reshape(-1, 3)).query(
        queries.reshape(-1, 3), k=at_most, distance_upper_bound=radius, workers=thread_count()
    )
    found = found.reshape(patches, -1, at_most) - (count * np.arange(patches))[:, None, None]
    return np.where(np.isfinite(distances).reshape(found.shape), found, around[..., None]).astype(np.int32)
