"""A worker process that does cells step by step: whatever ends it costs the step it was at, and nothing else.

Nothing heavy is imported here: a worker limits its threads before numpy is first imported.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import signal
import threading
import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any, Literal

from pebble import ProcessExpired, ProcessPool

from pcdbench.errors import PcdbenchError, told
from pcdbench.runner.jobs import Job, Limits
from pcdbench.runner.measuring import resident_bytes
from pcdbench.runner.output import Output, clear, last_lines
from pcdbench.runner.selection import Plugin
from pcdbench.workers import begin_worker, end_group, remove_temporary, take_output, temporary_place

if TYPE_CHECKING:
    from pcdbench.runner.execute import Executor, Step
    from pcdbench.runner.plan import Cell
    from pcdbench.runner.rows import Row

_LOOK_EVERY_SECONDS = 0.1
# Pebble does not tell of a worker that ended with exit code 0 in mid-step; by then its pid has been gone for long.
_LOOKS_UNTIL_LOST = 10
_STARTING_SECONDS = 600.0
_LAST_RESORT_SECONDS = 30.0
_DYING_SECONDS = 3.0


class Stopped(Exception):
    """The worker was told to stop."""


@dataclass(frozen=True)
class Death:
    """How a step ended that gave no answer.

    Attributes:
        crash: the process died of itself; another attempt may go better.
        worn: it may be the fault of what the process did before: only a new one's death counts.
    """

    error: str
    status: Literal["failed", "timeout"] = "failed"
    crash: bool = False
    worn: bool = False
    output: str | None = None


@dataclass
class Attempt:
    """A job as far as one process came with it.

    Attributes:
        stage: where it is, or ended.
        facts: what all rows of the cell say by now.
    """

    facts: Row
    stage: str = "worker"
    rows: list[Row] = field(default_factory=list)
    death: Death | None = None


class IsolatedWorker:
    """Runs jobs of one data set in a process of its own, which is replaced when it dies.

    One thread uses it; `stop` alone may be called by another.

    Args:
        dataset: of all jobs.
        threads: how many the process may use.
        limits: of each step.
    """

    def __init__(self, dataset: Plugin, threads: int, limits: Limits) -> None:
        self._dataset = dataset
        self._threads = threads
        self._limits = limits
        self._output = Output()
        self._temporary = temporary_place()
        self._pool: ProcessPool | None = None
        self._pid = 0
        self._jobs = 0
        self._stopped = threading.Event()
        self._lost: dict[Hashable, Death] = {}

    def rows(self, job: Job) -> list[Row]:
        """One row for each task of the job, whatever happens to the process.

        Raises:
            Stopped: after `stop`.
        """
        rows: list[Row] = []
        deaths = 0
        while left := job.tasks[len(rows) :]:
            attempt = self._attempt(Job(job.cell, left))
            rows += attempt.rows
            death = attempt.death
            if death is None or death.worn:
                continue
            deaths = 1 if attempt.rows else deaths + 1
            if death.crash and deaths <= self._limits.retries:
                continue
            made = _made_for(job.cell).get(attempt.stage)
            if made is not None:
                self._lost[made] = death
            culprits = left[len(attempt.rows) :][: 1 if attempt.stage == "evaluating" else None]
            rows += _failed_rows(job, culprits, attempt, deaths)
            deaths = 0
        return rows

    def stop(self) -> None:
        """End the process at once; whoever waits for its rows gets `Stopped`."""
        self._stopped.set()
        # Read once: closed meanwhile by the other thread it is 0, which names the group of the run itself.
        pid = self._pid
        if pid:
            end_group(pid)

    def close(self) -> None:
        """End the process and all that it started."""
        pool, self._pool = self._pool, None
        if pool is None:
            return
        if self._pid:
            end_group(self._pid)
        self._pid = 0
        pool.stop()
        pool.join()
        remove_temporary(self._temporary)

    def _attempt(self, job: Job) -> Attempt:
        """Do the job step by step until it is done, or the process is dead and gone."""
        from pcdbench.runner.rows import base_row

        attempt = Attempt(base_row(self._dataset, job.cell, self._threads))
        for stage, made in _made_for(job.cell).items():
            if made in self._lost:
                attempt.stage, attempt.death = stage, self._lost[made]
                return attempt
        if self._pool is None:
            attempt.death = self._start(job)
        self._jobs += 1
        for stage in ("scene", "case", "completing", *["evaluating"] * len(job.tasks)):
            if attempt.death is not None or len(attempt.rows) == len(job.tasks):
                break
            attempt.stage = stage
            answer = self._ask(_step, job if stage == "scene" else None, timeout_seconds=self._limits.timeout_seconds)
            if isinstance(answer, Death):
                attempt.death = answer
            else:
                attempt.facts = answer.facts
                attempt.rows += answer.rows
        if attempt.death is not None:
            self.close()
            # What an earlier cell left behind must not cost a scene all of its cells.
            if attempt.death.crash and attempt.stage in _made_for(job.cell) and self._jobs > 1:
                attempt.death = replace(attempt.death, worn=True)
        return attempt

    def _start(self, job: Job) -> Death | None:
        limit = self._limits.timeout_seconds
        arguments = (self._dataset, self._threads, limit, self._output.handle, self._temporary)
        self._pool = ProcessPool(1, initializer=_begin, initargs=arguments, context=get_context("spawn"))
        self._jobs = 0
        answer = self._ask(_get_ready, job, timeout_seconds=_STARTING_SECONDS)
        if isinstance(answer, Death):
            return answer
        self._pid = answer
        return None

    def _ask(self, function: Callable[..., Any], argument: Job | None, timeout_seconds: float) -> Any:
        """What a function gives in the process, or the `Death` of the process."""
        if self._stopped.is_set() or self._pool is None:
            raise Stopped
        limit_gb = self._limits.memory_gb
        over = lost = late = False
        looks_gone = 0
        # Pebble's own limit goes by the clock on the wall, which is set, and leaps when a machine wakes up.
        deadline = time.monotonic() + timeout_seconds
        try:
            future = self._pool.schedule(function, args=(argument,))
        except RuntimeError:
            return self._death("its worker process ended between two steps", crash=True, worn=self._jobs > 1)
        while not wait([future], _LOOK_EVERY_SECONDS).done:
            self._output.clip()
            if limit_gb is not None and self._pid and resident_bytes(self._pid) > limit_gb * 1e9:
                over = True
                end_group(self._pid)
            looks_gone = looks_gone + 1 if self._pid and not _is_there(self._pid) else 0
            lost = looks_gone > _LOOKS_UNTIL_LOST
            late = time.monotonic() > deadline
            if lost or late or self._stopped.is_set():
                break
        if self._stopped.is_set():
            raise Stopped
        if over:
            limit = f"its worker took more than {limit_gb:g} GB of memory (--memory-limit)"
            return self._death(limit, worn=self._jobs > 1)
        if lost:
            return self._death(_ending(0), crash=True)
        if late:
            if self._pid:
                _end_and_say_where(self._pid, future)
            return self._death(f"no answer after {timeout_seconds:g} s (--timeout)", status="timeout")
        try:
            return future.result()
        except ProcessExpired as expired:
            return self._death(_ending(expired.exitcode), crash=True)
        except BaseException as error:
            return self._death(f"its worker process failed: {told(error)}", crash=True)

    def _death(self, error: str, **how: Any) -> Death:
        return Death(error, output=self._output.last_lines(), **how)


def _made_for(cell: Cell) -> dict[str, Hashable]:
    """What other cells need as well, by the stage that makes it: where its making ends a process, it is lost to all."""
    return {"scene": cell.scene, "case": cell.case}


def _failed_rows(job: Job, tasks: Sequence[Plugin], attempt: Attempt, deaths: int) -> list[Row]:
    from pcdbench.runner.rows import new_row

    assert attempt.death is not None
    failed = {
        "status": attempt.death.status,
        "stage": attempt.stage,
        "error": attempt.death.error + (f", {deaths} times" if deaths > 1 else ""),
        "output": attempt.death.output,
    }
    return [new_row(attempt.facts, job.cell, task) | failed for task in tasks]


def _ending(exitcode: int | None) -> str:
    """How a process died, for people."""
    if exitcode is None or exitcode >= 0:
        return f"its worker process ended itself (exit code {exitcode})"
    try:
        name = signal.Signals(-exitcode).name
    except ValueError:
        name = f"signal {-exitcode}"
    cause = "out of memory, most likely" if exitcode == -signal.SIGKILL else "a crash in native code"
    return f"its worker process died of {name}: {cause}"


def _end_and_say_where(pid: int, future: Future[Any]) -> None:
    """End a process that hangs; it prints first where, if it can (see `begin_worker`)."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGTERM)
    wait([future], _DYING_SECONDS)
    end_group(pid)


def _is_there(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


# From here on: in the worker process.

_executor: Executor | None = None
_steps: Iterator[Step] = iter(())
_begun: _Begun


@dataclass(frozen=True)
class _Begun:
    """What this process began with, whatever plugins have done to it since."""

    dataset: Plugin
    timeout_seconds: float
    output: Connection
    folder: str
    pid: int


def _begin(dataset: Plugin, threads: int, timeout_seconds: float, output: Connection, temporary: str | None) -> None:
    global _begun
    begin_worker(threads, output.fileno(), temporary)
    folder = os.curdir
    with contextlib.suppress(OSError):  # where it is gone, there is nothing to come back to
        folder = os.getcwd()
    _begun = _Begun(dataset, timeout_seconds, output, folder, os.getpid())


def _get_ready(job: Job) -> int:
    """Import what the first job needs, so that no step's time limit counts it; gives the process's pid."""
    global _executor
    from pcdbench.plugins import registry
    from pcdbench.runner.completions import CompletionCache
    from pcdbench.runner.execute import Executor

    _executor = Executor(_begun.dataset, CompletionCache())
    for plugin in (_begun.dataset, job.cell.incompleteness, job.cell.completer, *job.tasks):
        with contextlib.suppress(PcdbenchError):
            registry().get(plugin.kind, plugin.name).load()
    return os.getpid()


def _step(job: Job | None) -> Step:
    """The next step of the job at hand, or the first one of `job`."""
    global _steps
    assert _executor is not None
    output = _begun.output.fileno()
    # Relative paths, of data sets, weights and the cache, are those of the command: a plugin may have gone elsewhere.
    with contextlib.suppress(OSError):
        os.chdir(_begun.folder)
    if job is not None:
        take_output(output)
        clear(output)
        _steps = _executor.steps(job.cell, job.tasks)
    # Where the parent is gone and native code hangs, nobody else ends this process.
    last_resort = min(_begun.timeout_seconds + _LAST_RESORT_SECONDS, threading.TIMEOUT_MAX)
    faulthandler.dump_traceback_later(last_resort, exit=True, file=output)
    try:
        step = next(_steps)
    finally:
        if os.getpid() != _begun.pid:
            os._exit(0)  # a plugin forked and came back twice: there is one worker
        faulthandler.cancel_dump_traceback_later()
    for row in step.rows:
        if row["status"] == "failed":
            row["output"] = last_lines(output)
    return step
