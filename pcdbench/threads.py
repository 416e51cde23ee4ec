"""How many threads this process may use: workers share the machine's cores, and libraries must not fight."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from pcdbench.errors import PcdbenchError

T = TypeVar("T")

VARIABLE = "PCDBENCH_THREADS"
_LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


def thread_count() -> int:
    """The threads this process may use: its share as set by `limit_threads`, else all cores it may run on.

    Pass it to whatever takes a number of threads (`cKDTree.query(workers=...)`, small_gicp, torch).

    Raises:
        PcdbenchError: where `PCDBENCH_THREADS` is set to what is no number of threads.
    """
    share = os.environ.get(VARIABLE, "")
    if share:
        if not share.isdecimal() or not int(share):
            raise PcdbenchError(f"{VARIABLE}={share} must be a number of threads, 1 or more; mend it or unset it")
        return int(share)
    return core_count() or 1


def core_count() -> int | None:
    """The cores this process may run on; None where the system does not tell."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def threads_are_limited() -> bool:
    """Whether `limit_threads` was called: in worker processes it was."""
    return VARIABLE in os.environ


def at_once(*work: Callable[[], T]) -> list[T]:
    """What each piece of work returns, by as many threads as this process may use; none must depend on another.

    It pays where most of the time goes by in libraries that let other threads run: large arrays, k-d trees.
    """
    threads = min(thread_count(), len(work))
    if threads < 2:
        return [its() for its in work]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda its: its(), work))


def limit_threads(count: int) -> None:
    """Give this process `count` threads. Call it before numpy, torch or open3d are imported."""
    os.environ.update(environment(count))


def environment(count: int) -> dict[str, str]:
    """The variables by which a process and its libraries know that they have `count` threads."""
    return dict.fromkeys((VARIABLE, *_LIBRARIES), str(count))


@contextmanager
def children_limited(count: int) -> Iterator[None]:
    """Processes that are started within have `count` threads: they find it in their environment before they import."""
    before = {variable: os.environ.get(variable) for variable in (VARIABLE, *_LIBRARIES)}
    limit_threads(count)
    try:
        yield
    finally:
        for variable, value in before.items():
            if value is None:
                del os.environ[variable]
            else:
                os.environ[variable] = value
