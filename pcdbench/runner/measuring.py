"""What a piece of work costs: its seconds, and by how much it made this process grow at its peak."""

from __future__ import annotations

import ctypes
import functools
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

_STATUS = "/proc/self/status"
_CLEAR = "/proc/self/clear_refs"


@dataclass
class Cost:
    """Measures what happens inside its `with` block.

    Attributes:
        seconds: wall-clock time.
        peak_memory_mb: the peak of the process's resident memory inside the block, less what it was at its
            start, freed memory not counted (1 MB = 10^6 bytes); None where the system cannot tell (Linux can).
    """

    seconds: float = 0.0
    peak_memory_mb: float | None = None

    def __enter__(self) -> Cost:
        self._resident_kb = _reset_peak()
        self._start = time.perf_counter()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.seconds = time.perf_counter() - self._start
        if self._resident_kb is not None:
            self.peak_memory_mb = round(max(0, _status_kb("VmHWM") - self._resident_kb) * 1024 / 1e6, 1)

    def as_json(self) -> dict[str, float | None]:
        """The two figures of a result row."""
        return {"seconds": round(self.seconds, 6), "peak_memory_mb": self.peak_memory_mb}


def resident_bytes(pid: int) -> int:
    """Resident memory of a process and of those that it started, pages that they share counted for each.

    A process that is gone, or a system that does not tell (Linux does), counts as 0.
    """
    folder = Path("/proc") / str(pid)
    try:
        total = int((folder / "statm").read_bytes().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        for children in folder.glob("task/*/children"):
            total += sum(resident_bytes(int(child)) for child in children.read_bytes().split())
    except (OSError, IndexError):
        return 0
    return total


def _reset_peak() -> int | None:
    """Set the recorded peak to what is resident now, and return that (kB); None where neither is possible."""
    # What earlier work freed stays resident, and a block that took it again would seem to need nothing.
    _trim_heap()
    try:
        with open(_CLEAR, "w") as clear:
            clear.write("5")
        return _status_kb("VmRSS")
    except OSError:
        return None


@functools.cache
def _malloc_trim() -> Callable[[int], int] | None:
    """The C library's own, where it has one (glibc has)."""
    try:
        return ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return None


def _trim_heap() -> None:
    """Give freed memory back to the system."""
    trim = _malloc_trim()
    if trim is not None:
        trim(0)


def _status_kb(field: str) -> int:
    with open(_STATUS) as status:
        for line in status:
            if line.startswith(field):
                return int(line.split()[1])
    raise OSError(f"{_STATUS} has no {field}")
