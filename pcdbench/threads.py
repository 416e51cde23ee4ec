"""How many threads this process may use: workers share the machine's cores, and libraries must not fight."""

from __future__ import annotations

import os

VARIABLE = "PCDBENCH_THREADS"
_LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


def thread_count() -> int:
    """The threads this process may use: its share as set by `limit_threads`, else all cores it may run on.

    Pass it to whatever takes a number of threads (`cKDTree.query(workers=...)`, small_gicp, torch).
    """
    share = os.environ.get(VARIABLE, "")
    if share.isdigit():
        return max(1, int(share))
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def limit_threads(count: int) -> None:
    """Give this process `count` threads. Call it before numpy, torch or open3d are imported."""
    os.environ[VARIABLE] = str(count)
    for variable in _LIBRARIES:
        os.environ[variable] = str(count)
