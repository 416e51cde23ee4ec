"""What is to be done and where: jobs, the order in which workers take them, and what every place for cells offers."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Generator, Hashable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from pcdbench.errors import PcdbenchError
from pcdbench.runner.selection import Plugin

if TYPE_CHECKING:
    from pcdbench.runner.plan import Cell
    from pcdbench.runner.rows import Row


@dataclass(frozen=True)
class Job:
    """A cell and those of its tasks whose rows are missing."""

    cell: Cell
    tasks: tuple[Plugin, ...]


@dataclass(frozen=True)
class Limits:
    """What a cell may take before it is given up.

    Attributes:
        timeout_seconds: for making a scene, making a case of it, completing it, and each evaluation, one by one.
        memory_gb: resident memory (1 GB = 10^9 bytes) of a worker and the processes it started; None: no limit.
        retries: how many more times a step is tried whose worker died. What raises or hangs is not tried again.

    Raises:
        PcdbenchError: for a limit that nothing can keep.
    """

    timeout_seconds: float = 600.0
    memory_gb: float | None = None
    retries: int = 1

    def __post_init__(self) -> None:
        if not (self.timeout_seconds > 0 and math.isfinite(self.timeout_seconds)):
            raise PcdbenchError(f"--timeout {self.timeout_seconds:g} must be a number of seconds above 0")
        if self.memory_gb is not None and not self.memory_gb > 0:
            raise PcdbenchError(f"--memory-limit {self.memory_gb:g} must be a number of GB above 0")
        if self.retries < 0:
            raise PcdbenchError(f"--retries {self.retries} must be 0 or more")


class CellExecutor(Protocol):
    """Where cells run: worker processes of this machine (`LocalProcesses`), or a cluster.

    Attributes:
        workers: how many cells run at once.
    """

    @property
    def workers(self) -> int: ...

    def run(self, jobs: Sequence[Job], dataset: Plugin) -> Generator[tuple[Job, list[Row]], None, None]:
        """Run all jobs; give each, as soon as it is done, with one row for each of its tasks.

        Whatever a plugin does costs its own rows. Closing the generator ends all work at once.
        """


class JobQueue:
    """Jobs in the order in which workers take them; workers may be threads.

    A worker takes the jobs of one scene after the other, so that scenes are made once; when none is left
    untouched, it helps with the one that has most left.
    """

    def __init__(self, jobs: Sequence[Job]) -> None:
        self._jobs: dict[str, deque[Job]] = {}
        for job in jobs:
            self._jobs.setdefault(job.cell.scene, deque()).append(job)
        self._at: dict[Hashable, str] = {}
        self._lock = threading.Lock()

    def take(self, worker: Hashable) -> Job | None:
        """The next job of this worker: of its scene, else of an untouched one, else of the longest queue."""
        with self._lock:
            scene = self._at.pop(worker, None)
            if not self._jobs:
                return None
            if scene not in self._jobs:
                taken = set(self._at.values())
                untouched = next((name for name in self._jobs if name not in taken), None)
                scene = untouched or max(self._jobs, key=lambda name: len(self._jobs[name]))
            self._at[worker] = scene
            queue = self._jobs[scene]
            job = queue.popleft()
            if not queue:
                del self._jobs[scene]
            return job

    def clear(self) -> None:
        """Nobody takes a job any more."""
        with self._lock:
            self._jobs.clear()
