"""Cells on Dask: an existing cluster of any make, or workers on this machine that Dask looks after.

A Dask worker does one cell at a time, in a process of its own (see `cluster_worker`), with as many threads as the
worker has. What it is sent is a job: names, options, seeds and digests, never a cloud. Scenes are made, and weights
loaded, where they are used.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import time
import uuid
from collections import Counter, deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

from pcdbench.downloads import is_address
from pcdbench.errors import PcdbenchError, told
from pcdbench.runner.cluster_worker import do_job, end_run
from pcdbench.runner.jobs import Job, JobQueue, Limits
from pcdbench.runner.selection import Plugin
from pcdbench.threads import thread_count

if TYPE_CHECKING:
    from dask.typing import Key
    from distributed import Client, Future

    from pcdbench.runner.rows import Row

# One that it is at, and one that it finds when that is done.
_JOBS_A_WORKER = 2
_LOOK_FOR_WORKERS_EVERY_SECONDS = 1.0
_CONNECTING_SECONDS = 30
_FIRST_WORKER_SECONDS = 300


@dataclass(frozen=True)
class DaskCluster:
    """The workers of a Dask cluster; a `CellExecutor`. `dask_cluster` gives one.

    Attributes:
        limits: what a cell may take.
    """

    client: Client
    limits: Limits = field(default_factory=Limits)

    @property
    def workers(self) -> int:
        """How many there are now; they may come and go."""
        return len(self.client.nthreads())

    def run(self, jobs: Sequence[Job], dataset: Plugin) -> Generator[tuple[Job, list[Row]], None, None]:
        """See `CellExecutor.run`.

        Raises:
            PcdbenchError: where the scheduler is lost, or a worker has other code than this process.
        """
        dispatch = _Dispatch(self.client, JobQueue(jobs), _as_workers_find_it(dataset), self.limits)
        try:
            for _ in jobs:
                yield dispatch.next_done()
        finally:
            dispatch.end()


@contextlib.contextmanager
def dask_cluster(
    scheduler: str | None = None, workers: int | None = None, limits: Limits | None = None
) -> Iterator[DaskCluster]:
    """A Dask cluster while the `with` block lasts.

    Args:
        scheduler: the address of a running scheduler; None starts workers on this machine.
        workers: how many to start there, one for each core unless given.
        limits: what a cell may take.

    Raises:
        PcdbenchError: where Dask is not installed, nothing answers at the address or no worker comes.
    """
    if workers is not None and workers < 1:
        raise PcdbenchError(f"--jobs {workers} must be at least 1")
    try:
        from distributed import Client
    except ImportError:
        raise PcdbenchError("--executor dask needs Dask; install it: pip install 'pcdbench[dask]'") from None
    # A client that could not connect ends when Python collects it, under a lock that the start of another one holds:
    # collected then, it would wait for ever (distributed 2026.8).
    gc.collect()
    with contextlib.ExitStack() as stack:
        if scheduler is None:
            client = stack.enter_context(_workers_of_this_machine(workers or thread_count()))
        else:
            try:
                client = stack.enter_context(Client(scheduler, timeout=_CONNECTING_SECONDS))
            except Exception as error:
                # Each protocol has errors of its own: of tls:// without certificates it is a TypeError.
                raise PcdbenchError(
                    f"no Dask scheduler answers at {scheduler} ({told(error)}); start one (dask scheduler), and give "
                    "the address that it prints"
                ) from None
        try:
            client.wait_for_workers(1, timeout=_FIRST_WORKER_SECONDS)
        except TimeoutError:
            raise PcdbenchError(
                f"the Dask scheduler at {scheduler} has no workers; start some: dask worker {scheduler}"
            ) from None
        yield DaskCluster(client, limits or Limits())


class _Dispatch:
    """Keeps every worker of a cluster in jobs, a few at a time, whatever becomes of the workers."""

    def __init__(self, client: Client, queue: JobQueue, dataset: Plugin, limits: Limits) -> None:
        self._client = client
        self._queue = queue
        self._run = uuid.uuid4().hex
        self._dataset = dataset
        self._limits = limits
        self._running: dict[Key, tuple[Future, Job, str]] = {}
        self._busy: Counter[str] = Counter()
        self._finished: SimpleQueue[Future] = SimpleQueue()
        self._done: deque[tuple[Job, list[Row]]] = deque()
        self._workers: frozenset[str] = frozenset()
        self._looked = 0.0

    def next_done(self) -> tuple[Job, list[Row]]:
        """The next job that is done, and its rows."""
        while not self._done:
            if not self._workers or time.monotonic() - self._looked > _LOOK_FOR_WORKERS_EVERY_SECONDS:
                self._look_for_workers()
            with contextlib.suppress(Empty):
                finished = [self._finished.get(timeout=_LOOK_FOR_WORKERS_EVERY_SECONDS)]
                while not self._finished.empty():
                    finished.append(self._finished.get())
                self._take(finished)
        return self._done.popleft()

    def end(self) -> None:
        """Nobody works for this run any more."""
        self._queue.clear()
        with contextlib.suppress(OSError, RuntimeError, TimeoutError):
            self._client.cancel([future for future, _, _ in self._running.values()], force=True)
            self._client.run(end_run, self._run, on_error="ignore")

    def _look_for_workers(self) -> None:
        """Workers come and go, and take over what others were at: each is given what it lacks."""
        with _saying_that_the_scheduler_is_lost():
            self._workers = frozenset(self._client.nthreads())
        self._looked = time.monotonic()
        self._fill(self._workers)

    def _fill(self, workers: frozenset[str]) -> None:
        for worker in sorted(workers & self._workers):
            while self._busy[worker] < _JOBS_A_WORKER:
                job = self._queue.take(worker)
                if job is None:
                    return
                self._busy[worker] += 1
                arguments = (self._run, self._dataset, self._limits, job)
                # Should the worker die, Dask gives the job to another one.
                future = self._client.submit(do_job, *arguments, pure=False, workers=[worker], allow_other_workers=True)
                self._running[future.key] = (future, job, worker)
                future.add_done_callback(self._finished.put)

    def _take(self, finished: Sequence[Future]) -> None:
        """Fetch, in one go, what these jobs gave, after their workers have been given the next ones."""
        ended = [(future, *self._running.pop(future.key)[1:]) for future in finished]
        self._busy.subtract(worker for _, _, worker in ended)
        self._fill(frozenset(worker for _, _, worker in ended))
        good = [future for future, *_ in ended if future.status == "finished"]
        with _saying_that_the_scheduler_is_lost():
            rows = dict(zip([future.key for future in good], self._client.gather(good), strict=True))
        for future, job, _ in ended:
            self._done.append((job, rows[future.key] if future.key in rows else self._failed_rows(future, job)))

    def _failed_rows(self, future: Future, job: Job) -> list[Row]:
        """Rows of a job that Dask gave up; what else can go wrong goes wrong with every job, and ends the run."""
        from distributed import KilledWorker

        from pcdbench.runner.rows import base_row, new_row

        error = future.exception() if future.status == "error" else CancelledError()
        if isinstance(error, KilledWorker):
            told = f"{error.allowed_failures + 1} Dask workers died of it, one after the other"
            failed = {"status": "failed", "stage": "worker", "error": told}
            base = base_row(self._dataset, job.cell, 1)
            return [new_row(base, job.cell, task) | failed for task in job.tasks]
        if isinstance(error, PcdbenchError):
            raise error
        with _saying_that_the_scheduler_is_lost():
            if isinstance(error, CancelledError):
                raise error
        raise PcdbenchError(
            f"a Dask worker cannot do cells ({type(error).__name__}: {error}); it needs the pcdbench and the plugins "
            "of this machine"
        ) from error


@contextlib.contextmanager
def _saying_that_the_scheduler_is_lost() -> Iterator[None]:
    try:
        yield
    except (OSError, CancelledError, TimeoutError) as error:
        raise PcdbenchError(
            f"the Dask scheduler is lost ({type(error).__name__}); the same command goes on where it ended"
        ) from error


@contextlib.contextmanager
def _workers_of_this_machine(count: int) -> Iterator[Client]:
    import dask
    from distributed import Client, LocalCluster

    with (
        dask.config.set({"distributed.worker.daemon": False}),
        # What a cell may take is limited by its own process: Dask sees the memory of the worker alone.
        LocalCluster(
            n_workers=count,
            threads_per_worker=max(1, thread_count() // count),
            processes=True,
            memory_limit=0,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _as_workers_find_it(dataset: Plugin) -> Plugin:
    """The data set with an absolute path, or its address: workers are in other folders."""
    if dataset.path is None or is_address(dataset.path):
        return dataset
    return replace(dataset, path=os.path.abspath(Path(dataset.path).expanduser()))
