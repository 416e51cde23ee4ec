"""The other side of fuzz_child.py: starts it, asks it, and takes its death or silence for an outcome."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

# The child ends itself after 20 s of processor time; on a busy machine, that and its imports take long.
_LONGEST_S = 120.0
# The bound that docs/trust.md states, for files this small.
MOST_MB = 256.0


@dataclass(frozen=True)
class Outcome:
    """How reading a file ended: "read", "refused", "raised", "crashed" or "hung"."""

    ended: str
    message: str
    grown_mb: float = 0.0
    seconds: float = 0.0

    def problem(self, path: Path) -> str:
        """What is wrong with it; "" where the file was read or refused as it should be."""
        if self.ended not in ("read", "refused"):
            return f"{self.ended}: {self.message}"
        if self.grown_mb > MOST_MB:
            return f"took {self.grown_mb:.0f} MB for {path.stat().st_size:,} bytes ({self.ended} {self.message})"
        if self.ended == "refused" and ("\n" in self.message or path.name.partition(".")[0] not in self.message):
            return f"its error is no line that names the file: {self.message}"
        return ""


class Reader:
    """A fuzz_child process, started anew after its death."""

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None
        self._unread = b""
        self._prepared = ""

    def outcome(self, target: str, path: Path) -> Outcome:
        """How the reader of this target ends on a file."""
        if self._child is None:
            command = [sys.executable, str(Path(__file__).with_name("fuzz_child.py"))]
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "100"}
            self._child = subprocess.Popen(command, bufsize=0, env=environment, **pipes)
            self._prepared, self._unread = "", b""
        assert self._child.stdin is not None
        self._child.stdin.write(f"{target} {path}\n".encode())
        if target != self._prepared:
            assert self._line() == "prepared\n", f"fuzz_child.py cannot prepare {target}"
            self._prepared = target
        answer = self._line()
        if answer:
            return Outcome(**json.loads(answer))
        code = self._child.wait(10) if answer == "" else None
        self.close()
        hung = code in (None, -signal.SIGPROF)
        return Outcome("hung", "20 s of processor time") if hung else Outcome("crashed", f"exit code {code}")

    def close(self) -> None:
        """End the process."""
        if self._child is not None:
            self._child.kill()
            self._child.communicate()
            self._child = None

    def _line(self) -> str | None:
        """The next line; "" where the process has ended, None where nothing came in time."""
        assert self._child is not None and self._child.stdout is not None
        # Two lines may come at once: a buffered reader would keep the second where select does not see it.
        while b"\n" not in self._unread:
            if not select.select([self._child.stdout], [], [], _LONGEST_S)[0]:
                return None
            more = self._child.stdout.read(65536)
            if not more:
                return ""
            self._unread += more
        line, _, self._unread = self._unread.partition(b"\n")
        return line.decode() + "\n"
