"""Points that repeat another's coordinates: they say nothing of a surface, and make it seem denser than it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_HASH_FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)


def repeats(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) which of (N, 3) points repeat an earlier one's coordinates."""
    # Equal points have equal hashes: only the few that share one are compared, which is fast for millions.
    bits = (points + 0.0).view(np.uint64)
    bits ^= bits >> np.uint64(32)
    hashes = bits @ _HASH_FACTORS
    order = np.argsort(hashes, kind="stable")
    same = np.diff(hashes[order]) == 0
    suspects = np.sort(order[np.append(same, False) | np.insert(same, 0, False)])
    again = np.zeros(len(points), np.bool_)
    if len(suspects):
        _, first = np.unique(points[suspects], axis=0, return_index=True)
        again[suspects] = True
        again[suspects[first]] = False
    return again


def share_held(cloud: NDArray[np.float64], wanted: NDArray[np.float64], known: NDArray[np.float64]) -> float:
    """The share of the (W, 3) `wanted` points, less those in `known`, that `cloud` has to the last bit; 0 of none."""
    new = wanted[~repeats(np.concatenate([known, wanted]))[len(known) :]]
    return float(repeats(np.concatenate([cloud, new]))[len(cloud) :].mean()) if len(new) else 0.0
