"""Runs killed with `kill -9` at random moments, and resumed, end with the rows of an undisturbed one."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from outcomes_for_tests import outcomes

# 50 moments are what is promised; these few are for every day.
KILLS = int(os.environ.get("PCDBENCH_TEST_KILLS", "5"))
# As `pcdbench run` does it, without the summary and the picture at its end.
RUN = """
import sys
from pathlib import Path
from pcdbench.runner.plan import Request, plan
from pcdbench.runner.run import carry_out, local_processes

if __name__ == "__main__":
    options = ["tiny_fill.seconds=0.02"]
    planned = plan(Request(["tiny_fill"], ["tiny_blind", "tiny_color"], "tiny", None, ["slab"], options=options))
    carry_out(planned, Path(sys.argv[1]), local_processes(2))
"""


@pytest.fixture
def command(tmp_path) -> list[str]:
    """A run; give it a folder."""
    (tmp_path / "run.py").write_text(RUN)
    return [sys.executable, str(tmp_path / "run.py")]


def rows(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / "rows.jsonl").read_text().splitlines()]


def outcome(folder: Path) -> dict:
    return outcomes(rows(folder))


def line_count(folder: Path) -> int:
    path = folder / "rows.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


def descendants(pid: int) -> set[int]:
    found = set()
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):  # a thread that has ended since the folder was listed
            for child in map(int, children.read_text().split()):
                found |= {child, *descendants(child)}
    return found


def killed(process: subprocess.Popen, folder: Path, moment: random.Random, whole_seconds: float) -> bool:
    """Kill a run at any time of its life, or just when rows come in; False where it had ended before."""
    start = time.monotonic()
    before = line_count(folder)
    if moment.random() < 0.4:
        after_seconds, after_rows = moment.uniform(0, whole_seconds), 10**9
    else:
        after_seconds, after_rows = 10 * whole_seconds, moment.randint(1, 16)
    while time.monotonic() - start < after_seconds and line_count(folder) - before < after_rows:
        if process.poll() is not None:
            return False
        time.sleep(0.002)
    time.sleep(moment.uniform(0, 0.03))
    workers = descendants(process.pid)
    if process.poll() is not None:
        return False
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    deadline = time.monotonic() + 30
    while any(Path(f"/proc/{pid}").exists() for pid in workers) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not [pid for pid in workers if Path(f"/proc/{pid}").exists()], "workers go with their run"
    return True


@pytest.mark.timeout(900 + 60 * KILLS)
def test_killed_at_random_moments_and_resumed_nothing_is_lost(command, tiny_plugins, tmp_path, monkeypatch):
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache-of-the-undisturbed"))
    monkeypatch.chdir(tmp_path)
    start = time.monotonic()
    subprocess.run([*command, "undisturbed"], capture_output=True, check=True)
    whole_seconds = time.monotonic() - start
    expected = outcome(tmp_path / "undisturbed")
    assert len(expected) == 3 * 3 * 4 * 2

    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    moment = random.Random(KILLS)
    kills = run = 0
    while kills < KILLS:
        folder = tmp_path / f"run{run}"
        process = subprocess.Popen([*command, folder.name], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        if killed(process, folder, moment, whole_seconds):
            kills += 1
        else:
            assert process.wait() == 0, process.stderr.read()
            assert outcome(folder) == expected and len(rows(folder)) == len(expected)
            run += 1
        process.stderr.close()
    subprocess.run([*command, folder.name], capture_output=True, check=True)
    assert outcome(folder) == expected
    assert len(rows(folder)) == len(expected), "none twice"
    assert not list(folder.glob("run.json?*"))
