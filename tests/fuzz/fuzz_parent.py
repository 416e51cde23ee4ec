"""The other side of fuzz_child.py: starts it, asks it, and takes its death or silence for an outcome."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

# No file here is larger than some kilobytes.
LONGEST_S = 20.0
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
        self._child: subprocess.Popen[str] | None = None

    def outcome(self, target: str, path: Path) -> Outcome:
        if self._child is None:
            command = [sys.executable, str(Path(__file__).with_name("fuzz_child.py"))]
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "100"}
            self._child = subprocess.Popen(command, text=True, env=environment, **pipes)
            # Its imports are not the file's time.
            self._ask("warm-up", Path(os.devnull), 120.0)
        return self._ask(target, path, LONGEST_S)

    def close(self) -> None:
        if self._child is not None:
            self._child.kill()
            self._child.communicate()
            self._child = None

    def _ask(self, target: str, path: Path, longest_s: float) -> Outcome:
        child = self._child
        assert child is not None and child.stdin is not None and child.stdout is not None
        child.stdin.write(f"{target} {path}\n")
        child.stdin.flush()
        ready, _, _ = select.select([child.stdout], [], [], longest_s)
        answer = child.stdout.readline() if ready else ""
        if answer:
            return Outcome(**json.loads(answer))
        self.close()
        return Outcome("crashed", f"exit code {child.returncode}") if ready else Outcome("hung", f"{longest_s:.0f} s")
