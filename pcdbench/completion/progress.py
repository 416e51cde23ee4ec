"""How far a completion is, on standard error: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from pcdbench.runner.progress import duration

_LINE_EVERY_SECONDS = 15.0


class TileProgress:
    """Shows what share of the observed points is done, and how long the rest will take, inside its `with` block."""

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._start = self._last_line = time.monotonic()
        self._bar = Progress(
            TextColumn("completing"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
        )

    def __enter__(self) -> TileProgress:
        self._bar.start()
        self._task = self._bar.add_task("completing", total=1.0, left="")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._bar.stop()

    def done(self, points: int, of: int) -> None:
        """Note that so many of the observed points are in tiles that are done."""
        now = time.monotonic()
        elapsed = now - self._start
        left = f"about {duration(elapsed * (of - points) / max(1, points))} left"
        self._bar.update(self._task, completed=points / of, left=left)
        if not self._console.is_terminal and (now - self._last_line >= _LINE_EVERY_SECONDS or points == of):
            self._last_line = now
            text = f"{100 * points / of:.0f} % of {of:,} points in {duration(elapsed)}"
            print(text if points == of else f"{text}, {left}", file=sys.stderr, flush=True)
