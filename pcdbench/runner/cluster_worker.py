"""What a Dask worker does: one cell after the other, in a process that outlives the cell but not the run.

The process is an `IsolatedWorker`: time limits, memory limits, crashes and models that are loaded once are the same
as on one machine. The Dask worker itself holds no scene and no model.
"""

from __future__ import annotations

import multiprocessing
import threading
from typing import TYPE_CHECKING

from pcdbench.errors import PluginError
from pcdbench.runner.isolated import IsolatedWorker
from pcdbench.runner.jobs import Job, Limits
from pcdbench.runner.selection import Plugin

if TYPE_CHECKING:
    from pcdbench.runner.rows import Row

# A run that was killed does not tell its workers.
_IDLE_SECONDS = 600.0


class _Place:
    """The process in which this worker does the cells of one run."""

    def __init__(self, dataset: Plugin, threads: int, limits: Limits) -> None:
        # Dask makes its workers daemons, which may not start processes; this one ends with its worker anyhow.
        multiprocessing.current_process().daemon = False
        self._worker = IsolatedWorker(dataset, threads, limits)
        self._dataset = dataset
        self._checked: set[tuple[str, str]] = set()
        self._turn = threading.Lock()
        self._ended = False
        self._idle = threading.Timer(_IDLE_SECONDS, self._rest)

    def rows(self, job: Job) -> list[Row]:
        with self._turn:
            if self._ended:
                return []
            self._idle.cancel()
            for plugin in (self._dataset, job.cell.incompleteness, job.cell.completer, *job.tasks):
                if (plugin.kind, plugin.name) not in self._checked:
                    _check_code(plugin)
                    self._checked.add((plugin.kind, plugin.name))
            try:
                return self._worker.rows(job)
            finally:
                self._idle = threading.Timer(_IDLE_SECONDS, self._rest)
                self._idle.daemon = True
                self._idle.start()

    def end(self) -> None:
        self._worker.stop()
        with self._turn:
            self._ended = True
            self._idle.cancel()
            self._worker.close()

    def _rest(self) -> None:
        """Give up the process; the next job starts another one."""
        with self._turn:
            self._worker.close()


_places: dict[str, _Place] = {}
_ended: set[str] = set()
_lock = threading.Lock()


def do_job(run: str, dataset: Plugin, limits: Limits, job: Job) -> list[Row]:
    """The rows of a job; none of a run that has ended, whose last jobs may come after that was told.

    Args:
        run: what tells this run from others on the same cluster.

    Raises:
        PluginError: where a plugin is missing here, or is other code than where the run was planned.
    """
    from distributed import get_worker

    with _lock:
        if run in _ended:
            return []
        if run not in _places:
            _places[run] = _Place(dataset, get_worker().state.nthreads, limits)
        place = _places[run]
    return place.rows(job)


def end_run(run: str) -> None:
    """End the process that this worker has for a run, in mid-cell even."""
    with _lock:
        _ended.add(run)
        place = _places.pop(run, None)
    if place is not None:
        place.end()


def _check_code(plugin: Plugin) -> None:
    """A worker with other code would fill a run with results that are not those of its configuration."""
    from distributed import get_worker

    if plugin.code_here() != plugin.code:
        raise PluginError(
            f"the Dask worker {get_worker().address} has other code of {plugin.kind} {plugin.name!r} than the machine "
            "that started the run; install the same versions there"
        )
