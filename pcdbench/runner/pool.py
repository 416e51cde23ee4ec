"""Where cells run: worker processes of this machine, each with its share of threads and its own scenes.

Nothing heavy is imported here: a worker limits its threads before numpy is first imported.
"""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pebble import ProcessExpired, ProcessPool

from pcdbench.runner.selection import Plugin
from pcdbench.threads import thread_count
from pcdbench.workers import begin_worker

if TYPE_CHECKING:
    from pcdbench.runner.execute import Executor
    from pcdbench.runner.plan import Cell
    from pcdbench.runner.rows import Row


@dataclass(frozen=True)
class Job:
    """A cell and those of its tasks whose rows are missing."""

    cell: Cell
    tasks: tuple[Plugin, ...]


def run_jobs(jobs: Sequence[Job], dataset: Plugin, workers: int) -> Iterator[tuple[Job, list[Row]]]:
    """Run jobs in worker processes and give each with its rows as soon as they are there.

    A worker takes the jobs of one scene after the other, so that scenes are made once; when none is left
    untouched, it helps with the one that has most left. A worker that dies costs the cell it was at, and is
    replaced. Closing the iterator (Ctrl-C does) ends the workers.
    """
    queues = _queues(jobs)
    lanes = [_Lane(dataset, max(1, thread_count() // workers)) for _ in range(min(workers, len(jobs)))]
    running: dict[Future, tuple[_Lane, Job]] = {}
    try:
        for lane in lanes:
            _give_next(lane, queues, running)
        while running:
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                lane, job = running.pop(future)
                rows = _rows(future, job, dataset)
                _give_next(lane, queues, running)
                yield job, rows
    finally:
        for lane in lanes:
            lane.stop()


class _Lane:
    """One worker process and the scene it is at."""

    def __init__(self, dataset: Plugin, threads: int) -> None:
        self._arguments = (dataset, threads)
        self._pool: ProcessPool | None = None
        self.scene = ""

    def start(self, job: Job) -> Future:
        if self._pool is None or not self._pool.active:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPool(1, initializer=_begin_worker, initargs=self._arguments, context=context)
        return self._pool.schedule(_run_in_worker, args=(job,))

    def stop(self) -> None:
        if self._pool is not None:
            self._pool.stop()
            self._pool.join()


def _queues(jobs: Sequence[Job]) -> dict[str, deque[Job]]:
    queues: dict[str, deque[Job]] = {}
    for job in jobs:
        queues.setdefault(job.cell.scene, deque()).append(job)
    return queues


def _give_next(lane: _Lane, queues: dict[str, deque[Job]], running: dict[Future, tuple[_Lane, Job]]) -> None:
    """Start the lane on the next job of its scene, else of an untouched one, else of the longest queue."""
    if not queues:
        return
    if lane.scene not in queues:
        taken = {other.scene for other, _ in running.values()}
        untouched = next((scene for scene in queues if scene not in taken), None)
        lane.scene = untouched or max(queues, key=lambda scene: len(queues[scene]))
    queue = queues[lane.scene]
    job = queue.popleft()
    if not queue:
        del queues[lane.scene]
    running[lane.start(job)] = (lane, job)


def _rows(future: Future, job: Job, dataset: Plugin) -> list[Row]:
    from pcdbench.runner.rows import new_row

    try:
        return future.result()
    except ProcessExpired as death:
        reason = f"the worker process died (exit code {death.exitcode}): a crash in native code, or out of memory"
    except Exception as error:
        reason = f"the worker process failed: {type(error).__name__}: {error}"
    base = {"dataset": dataset.describe() | {"digest": job.cell.scene_digest}}
    failed = {"status": "failed", "stage": "worker", "error": reason}
    return [new_row(base, job.cell, task) | failed for task in job.tasks]


_executor: Executor | None = None
_begun: tuple[Plugin] | None = None


def _begin_worker(dataset: Plugin, threads: int) -> None:
    global _begun
    begin_worker(threads)
    _begun = (dataset,)


def _run_in_worker(job: Job) -> list[Row]:
    global _executor
    if _executor is None:
        from pcdbench.runner.completions import CompletionCache
        from pcdbench.runner.execute import Executor

        assert _begun is not None
        _executor = Executor(_begun[0], CompletionCache())
    return _executor.rows(job.cell, job.tasks)
