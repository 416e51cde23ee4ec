"""A fixed job that tells how fast a machine is: times of two runs compare as ratios to it."""

from __future__ import annotations

import time
from functools import cache

_REPEATS = 3
_POINTS = 60_000


@cache
def calibration_seconds() -> float:
    """The shortest of three timings of a job of about a third of a second, by one thread; once a process.

    The job is neighbours by a KD-tree, sorting and a Fourier transform: nothing that takes more than one thread. The
    shortest is the one that other work on the machine disturbed least.
    """
    return min(_timed_job() for _ in range(_REPEATS))


def _timed_job() -> float:
    import numpy as np
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(0)
    points = rng.random((_POINTS, 3))
    start = time.perf_counter()
    cKDTree(points).query(points, k=8, workers=1)
    np.sort(rng.random(10 * _POINTS))
    np.fft.rfft(rng.random(2**20))
    return time.perf_counter() - start
