"""How far a run is, on standard error: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from pcdbench.runner.jobs import Job

if TYPE_CHECKING:
    from pcdbench.runner.rows import Row

_LINE_EVERY_SECONDS = 15.0


class RunProgress:
    """Shows how many cells are done and how long the rest will take, while its `with` block lasts."""

    def __init__(self, jobs: Sequence[Job], workers: int, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._remaining = RemainingTime(jobs, workers)
        self._total = len(jobs)
        self._done = 0
        self._failed = 0
        self._start = self._last_line = time.monotonic()
        self._bar = Progress(
            TextColumn("cells"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            TextColumn("[red]{task.fields[failed]}"),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
        )

    def __enter__(self) -> RunProgress:
        self._bar.start()
        self._task = self._bar.add_task("cells", total=self._total, left="", failed="")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._bar.stop()

    def done(self, job: Job, rows: Sequence[Row]) -> None:
        """Note that a cell is done."""
        now = time.monotonic()
        self._done += 1
        self._failed += any(row["status"] not in ("ok", "skipped") for row in rows)
        self._remaining.done(job, now - self._start)
        left = f"about {duration(self._remaining.seconds())} left"
        failed = f"{self._failed} failed" if self._failed else ""
        self._bar.update(self._task, completed=self._done, left=left, failed=failed)
        if not self._console.is_terminal and (
            now - self._last_line >= _LINE_EVERY_SECONDS or self._done == self._total
        ):
            self._last_line = now
            parts = [f"{self._done} of {self._total} cells in {duration(now - self._start)}"]
            parts += [left] if self._done < self._total else []
            parts += [failed] if failed else []
            print(", ".join(parts), file=sys.stderr, flush=True)


class RemainingTime:
    """Estimates how long the rest of a run takes, from what cells of the same completer took until now."""

    def __init__(self, jobs: Sequence[Job], workers: int) -> None:
        self._left = Counter(job.cell.completer.name for job in jobs)
        self._finished: Counter[str] = Counter()
        self._busy_seconds: dict[str, float] = {}
        self._workers = max(1, min(workers, len(jobs)))
        self._elapsed = 0.0

    def done(self, job: Job, elapsed_seconds: float) -> None:
        """Note a finished cell; the time since the last one, of all workers, is put down to its completer."""
        name = job.cell.completer.name
        spent = (elapsed_seconds - self._elapsed) * self._workers
        self._busy_seconds[name] = self._busy_seconds.get(name, 0.0) + spent
        self._elapsed = elapsed_seconds
        self._finished[name] += 1
        self._left[name] -= 1

    def seconds(self) -> float:
        """Seconds until the run ends; completers not seen yet count as the mean of those seen."""
        mean = sum(self._busy_seconds.values()) / max(1, self._finished.total())
        each = {name: spent / self._finished[name] for name, spent in self._busy_seconds.items()}
        return sum(left * each.get(name, mean) for name, left in self._left.items()) / self._workers


def duration(seconds: float) -> str:
    """Seconds for people: `42 s`, `3 min 20 s`, `2 h 5 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
