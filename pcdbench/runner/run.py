"""A run: the cells of a plan whose rows are missing, carried out and stored."""

from __future__ import annotations

import contextlib
import platform
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pcdbench.errors import PcdbenchError
from pcdbench.runner.calibration import calibration_seconds
from pcdbench.runner.completions import CompletionCache
from pcdbench.runner.jobs import CellExecutor, Job, Limits
from pcdbench.runner.plan import Plan
from pcdbench.runner.pool import LocalProcesses
from pcdbench.runner.progress import RunProgress
from pcdbench.runner.provenance import provenance
from pcdbench.runner.rows import Row, utc_now
from pcdbench.runner.store import PLANNED_ROWS, RunStore
from pcdbench.threads import thread_count

RUNS = Path("runs")


@dataclass(frozen=True)
class Run:
    """A run that has ended.

    Attributes:
        rows: all its rows, those of earlier invocations too.
        new_cells: how many cells this invocation carried out.
    """

    plan: Plan
    folder: Path
    rows: Sequence[Row]
    new_cells: int

    @property
    def failed(self) -> list[Row]:
        """Rows that have no measurements though they should."""
        return [row for row in self.rows if row["status"] not in ("ok", "skipped")]


def carry_out(plan: Plan, folder: Path | None = None, executor: CellExecutor | None = None) -> Run:
    """Run the cells of `plan` that the folder has no finished rows of; rows that failed are tried again.

    Args:
        folder: `runs/<data set>-<split>-<digest of the configuration>` unless given.
        executor: where cells run; `local_processes()` unless given.

    Raises:
        PcdbenchError: where the folder or the cache's limit cannot be used or not one scene could be.
    """
    folder = RUNS / plan.folder_name if folder is None else folder
    executor = local_processes() if executor is None else executor
    completions = CompletionCache()
    facts: dict[str, Any] = {
        "command": shlex.join(["pcdbench", *sys.argv[1:]]),
        "dataset_path": plan.dataset.path,
        "left_out": dict(plan.left_out),
        PLANNED_ROWS: len(plan.cells) * len(plan.tasks),
    }
    with RunStore(folder, plan.configuration, facts) as store:
        stored = store.rows()
        jobs = missing_jobs(plan, stored.finished_keys)
        if jobs:
            circumstances = {
                "workers": executor.workers,
                "time": utc_now(),
                **provenance(),
                "calibration_seconds": round(calibration_seconds(), 4),
            }
            store.record(platform.node(), circumstances)
        with (
            RunProgress(jobs, executor.workers) as progress,
            contextlib.closing(executor.run(jobs, plan.dataset)) as results,
        ):
            for job, rows in results:
                store.append(rows)
                progress.done(job, rows)
        if jobs:
            completions.trim()
            stored = store.rows()
    if stored and all(row["stage"] == "scene" for row in stored):
        others = f" (and {len(plan.scenes) - 1} more)" if len(plan.scenes) > 1 else ""
        raise PcdbenchError(
            f"no scene of {plan.dataset.name} can be used: {stored[0]['scene']}{others}: {stored[0]['error']}"
        )
    return Run(plan, folder, stored, len(jobs))


def local_processes(workers: int | None = None, limits: Limits | None = None) -> LocalProcesses:
    """Worker processes of this machine, one for each core unless `workers` says how many.

    Raises:
        PcdbenchError: for less than one.
    """
    count = thread_count() if workers is None else workers
    if count < 1:
        raise PcdbenchError(f"--jobs {count} must be at least 1")
    return LocalProcesses(count, limits or Limits())


def missing_jobs(plan: Plan, finished: set[str]) -> list[Job]:
    """The cells with a row missing, each with the tasks of those rows."""
    jobs = []
    for cell in plan.cells:
        tasks = tuple(task for task in plan.tasks if cell.row_key(task) not in finished)
        if tasks:
            jobs.append(Job(cell, tasks))
    return jobs
