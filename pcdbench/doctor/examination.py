"""Runs the self-tests in a process of their own, which broken native libraries may kill or hang."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import IO

_LONGEST_S = 60.0


@dataclass(frozen=True)
class Finding:
    """How the self-test of one thing ended."""

    name: str
    ok: bool
    message: str


def findings(names: Sequence[str], longest_s: float = _LONGEST_S) -> Iterator[Finding]:
    """How each check ended, in order, as soon as it has: a check that kills its process or takes longer has failed."""
    done = 0
    while done < len(names):
        for finding in _findings_of_a_process(names[done:], longest_s):
            yield finding
            done += 1


def _findings_of_a_process(names: Sequence[str], longest_s: float) -> Iterator[Finding]:
    """How checks ended in one process, up to and with the one that ended it."""
    command = [sys.executable, "-m", "pcdbench.doctor.checks", *names]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        said: list[str] = []
        # Read meanwhile: a full pipe would stop the process.
        reader = threading.Thread(target=said.extend, args=(process.stderr,), daemon=True)
        reader.start()
        for name in names:
            hung = threading.Event()
            line = _line_within(process.stdout, longest_s, hung, process)
            if not line:
                process.wait()
                reader.join(timeout=5)
                yield Finding(name, False, _death(hung.is_set(), longest_s, process.returncode, said))
                return
            yield Finding(**json.loads(line))


def _line_within(stream: IO[str], seconds: float, hung: threading.Event, process: subprocess.Popen[str]) -> str:
    """The next line; where none comes, `hung` is set and the process killed."""

    def give_up() -> None:
        hung.set()
        process.kill()

    timer = threading.Timer(seconds, give_up)
    timer.start()
    try:
        return stream.readline()
    finally:
        timer.cancel()


def _death(hung: bool, longest_s: float, code: int, said: list[str]) -> str:
    if hung:
        return f"no answer within {longest_s:.0f} s"
    how = f"by {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
    last = next((line.strip() for line in reversed(said) if line.strip()), "")
    return f"its process ended {how}" + (f": {last[:200]}" if last else "")
