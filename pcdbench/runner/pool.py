"""Where cells run unless told otherwise: worker processes of this machine, each with its share of threads."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import TYPE_CHECKING

from pcdbench.errors import PcdbenchError
from pcdbench.runner.isolated import IsolatedWorker, Stopped
from pcdbench.runner.jobs import Job, JobQueue, Limits
from pcdbench.runner.selection import Plugin
from pcdbench.threads import thread_count

if TYPE_CHECKING:
    from pcdbench.runner.rows import Row

_STOPPING_SECONDS = 10.0


@dataclass(frozen=True)
class LocalProcesses:
    """Worker processes of this machine; a `CellExecutor`.

    Attributes:
        workers: how many.
        limits: what a cell may take.
    """

    workers: int
    limits: Limits = field(default_factory=Limits)

    def run(self, jobs: Sequence[Job], dataset: Plugin) -> Generator[tuple[Job, list[Row]], None, None]:
        """See `CellExecutor.run`."""
        queue = JobQueue(jobs)
        results: _Results = SimpleQueue()
        threads = max(1, thread_count() // self.workers)
        try:
            workers = [IsolatedWorker(dataset, threads, self.limits) for _ in range(min(self.workers, len(jobs)))]
        except OSError as error:
            raise _refused(error) from error
        lanes = [threading.Thread(target=_work, args=(worker, queue, results), daemon=True) for worker in workers]
        for lane in lanes:
            lane.start()
        try:
            for _ in jobs:
                result = results.get()
                if isinstance(result, BaseException):
                    raise result
                yield result
        finally:
            queue.clear()
            for worker in workers:
                worker.stop()
            for lane in lanes:
                lane.join(_STOPPING_SECONDS)


_Results = SimpleQueue["tuple[Job, list[Row]] | BaseException"]


def _work(worker: IsolatedWorker, queue: JobQueue, results: _Results) -> None:
    """Do jobs until none is left; what only a fault of the harness can raise ends the run."""
    # Blocked here, it stays blocked in the process that is spawned: Ctrl-C is for the run, which ends its workers.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        while (job := queue.take(worker)) is not None:
            results.put((job, worker.rows(job)))
    except Stopped:
        return
    except OSError as error:
        results.put(_refused(error))
    except BaseException as error:
        results.put(error)
    finally:
        worker.close()


def _refused(error: OSError) -> PcdbenchError:
    return PcdbenchError(
        f"a worker process cannot be started ({error.strerror}); give fewer --jobs, or the system's limits (ulimit -n) "
        "more room"
    )
