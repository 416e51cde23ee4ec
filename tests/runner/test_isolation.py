"""Every way in which a plugin can go wrong costs its own cell: the row says why, with its last words."""

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest

from pcdbench.errors import PcdbenchError
from pcdbench.runner.isolated import IsolatedWorker
from pcdbench.runner.jobs import Limits
from pcdbench.runner.plan import Request, plan
from pcdbench.runner.run import carry_out, local_processes, missing_jobs

pytestmark = pytest.mark.usefixtures("tiny_plugins")
TENTHS = [number / 10 for number in range(1, 10)]
TINY = Request(["tiny_troubled"], ["tiny_blind"], "tiny", None, ["slab"], references=False, options=["tiny.scenes=1"])
LIMITS = Limits(timeout_seconds=120.0, memory_gb=0.6, retries=0)
SHORT = Limits(timeout_seconds=5.0, retries=0)


@pytest.fixture
def run_rows(tmp_path, monkeypatch):
    """A function that carries out a request in one worker process: rows by level and task."""
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))

    def run(*options, limits=LIMITS, **changes):
        request = replace(TINY, **changes)
        planned = plan(replace(request, options=[*request.options, *options]))
        ended = carry_out(planned, tmp_path / "run", local_processes(1, limits))
        rows = {(row["level"], row["task"]["name"]): row for row in ended.rows}
        assert len(rows) == len(ended.rows) == len(planned.cells) * len(planned.tasks)
        return rows

    return run


def test_whatever_a_completer_does_costs_its_own_cell(run_rows):
    ways = ["crash", "", "leak", "vanish", "quit", "kill", "exit", "flood"]
    rows = run_rows(f"tiny_troubled.how={','.join(ways)}", levels=TENTHS[: len(ways)])
    found = {way: rows[level, "tiny_blind"] for way, level in zip(ways, TENTHS, strict=False)}
    assert found[""]["status"] == "ok" and found[""]["output"] is None
    reasons = {
        "crash": "died of SIGSEGV: a crash in native code",
        "leak": "took more than 0.6 GB of memory (--memory-limit)",
        "vanish": "ended itself (exit code 0)",
        "quit": "ended itself (exit code 7)",
        "kill": "died of SIGKILL: out of memory, most likely",
        "exit": "SystemExit: good bye",
        "flood": "died of SIGSEGV: a crash in native code",
    }
    for way, reason in reasons.items():
        assert (found[way]["status"], found[way]["stage"]) == ("failed", "completing")
        assert reason in found[way]["error"]
        if way != "flood":
            assert found[way]["output"].splitlines()[0] == f"about to {way}"
    crash, flood = found["crash"]["output"], found["flood"]["output"]
    assert "printed by C" in crash and "Segmentation fault" in crash and "in misbehave" in crash
    assert len(flood) <= 8_000 and "the last line\nFatal Python error" in flood, "three million letters were printed"


def test_whatever_hangs_is_ended_with_all_that_it_started(run_rows, tmp_path):
    ways = [f"breed:{tmp_path / 'pid'}", "freeze"]
    rows = run_rows(f"tiny_troubled.how={','.join(ways)}", levels=TENTHS[:2], limits=SHORT)
    for way, level in zip(ways, TENTHS, strict=False):
        row = rows[level, "tiny_blind"]
        assert (row["status"], row["stage"]) == ("timeout", "completing")
        assert row["error"] == "no answer after 5 s (--timeout)"
        assert f"about to {way}" in row["output"] and "in misbehave" in row["output"]
    assert gone_soon(int((tmp_path / "pid").read_text()))


def test_a_task_costs_its_own_row_and_the_completion_is_not_lost(run_rows):
    ways = ["crash", "hang", "raise", ""]
    tasks = ["tiny_blind", "tiny_trouble", "tiny_color"]
    rows = run_rows(
        f"tiny_trouble.how={','.join(ways)}",
        completers=["tiny_fill"],
        tasks=tasks,
        levels=TENTHS[: len(ways)],
        limits=SHORT,
    )
    for way, level in zip(ways, TENTHS, strict=False):
        blind, trouble, color = (rows[level, task] for task in tasks)
        assert (blind["status"], color["status"]) == ("ok", "ok")
        assert blind["completing"]["cached"] is False and color["completing"]["cached"] is (way in ("crash", "hang"))
        assert trouble["status"] == {"hang": "timeout", "": "ok"}.get(way, "failed")
        assert trouble["stage"] == ("evaluating" if way else None)
        assert trouble["points"] == blind["points"], "what was known when it died stays"
        if way:
            assert f"about to {way}" in trouble["output"]


def test_a_death_in_the_last_step_of_a_cell_or_after_it_costs_no_other_cell(tmp_path, monkeypatch):
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    options = ["tiny_trouble.how=quit,,linger", "tiny.scenes=1"]
    planned = plan(replace(TINY, completers=["tiny_fill"], tasks=["tiny_trouble"], levels=TENTHS[:4], options=options))
    worker = IsolatedWorker(planned.dataset, 1, LIMITS)
    try:
        statuses = []
        for job in missing_jobs(planned, set()):
            (row,) = worker.rows(job)
            statuses.append(row["status"])
            if job.cell.level == 0.3:
                assert gone_soon(worker._pid)
                time.sleep(0.5)
    finally:
        worker.close()
    assert statuses == ["failed", "ok", "ok", "ok"]


def test_a_scene_that_cannot_be_made_is_not_tried_for_each_of_its_cells(tmp_path, monkeypatch):
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    tally = tmp_path / "tally"
    options = [f"tiny.how=tally:{tally}", "tiny.scenes=2"]
    planned = plan(replace(TINY, completers=["tiny_fill", "tiny_colorful"], options=options))
    ended = carry_out(planned, tmp_path / "run", local_processes(1, LIMITS))
    found = {(row["scene"], row["status"], row["stage"]) for row in ended.rows}
    assert found == {("box0", "failed", "scene"), ("box1", "ok", None)}
    assert len(ended.rows) == 12 and tally.read_text() == "x"


def test_a_death_while_a_case_is_made_is_that_cases_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    tally = tmp_path / "tally"
    request = replace(TINY, completers=["tiny_fill", "tiny_colorful"], incompletenesses=["troubled_slab", "slab"])
    options = [f"troubled_slab.how=tally:{tally}", "tiny.scenes=1"]
    planned = plan(replace(request, levels=[0.1, 0.3], options=options))
    ended = carry_out(planned, tmp_path / "run", local_processes(1, LIMITS))
    found = [(row["incompleteness"]["name"], row["level"], row["status"], row["stage"]) for row in ended.rows]
    lost, sound = ("troubled_slab", 0.1, "failed", "case"), ("ok", None)
    assert found == [lost] * 2 + [
        (*of, *sound) for of in (("troubled_slab", 0.3), ("slab", 0.1), ("slab", 0.3)) for _ in "ab"
    ]
    assert tally.read_text() == "x", "it is not tried for each completer"


def test_what_dies_once_is_tried_again_and_what_raises_is_not(run_rows, tmp_path):
    mark = tmp_path / "mark"
    rows = run_rows(f"tiny_troubled.how=mark:{mark},crash,raise", levels=TENTHS[:3], limits=replace(LIMITS, retries=1))
    once, always, raised = (rows[level, "tiny_blind"] for level in TENTHS[:3])
    assert mark.exists() and once["status"] == "ok"
    assert always["error"].endswith("a crash in native code, 2 times")
    assert raised["error"] == "ZeroDivisionError: no plane"


def test_what_a_cell_does_to_its_process_costs_no_other_cell(run_rows):
    ways = ["hush", "raise", "shut", "raise", "redirect", "raise", "garble", ""]
    rows = run_rows(f"tiny_troubled.how={','.join(ways)}", levels=TENTHS[: len(ways)])
    *misbehaved, garbled, last = (rows[level, "tiny_blind"] for level in TENTHS[: len(ways)])
    assert [row["status"] for row in (*misbehaved[::2], last)] == ["ok"] * 4
    outputs = [row["output"] for row in misbehaved[1::2]]
    assert outputs == ["about to raise"] * 3, "printed after the output was taken away"
    assert garbled["error"] == "Unspeakable: (its message cannot be shown)"


def test_a_folder_that_a_plugin_goes_to_is_left_again(run_rows, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PCDBENCH_CACHE", "cache")
    rows = run_rows(f"tiny_troubled.how=wander:{tmp_path / 'elsewhere'},mark:mark", levels=TENTHS[:2])
    assert rows[0.2, "tiny_blind"]["status"] == "failed" and (tmp_path / "mark").exists()
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_copy_of_the_worker_that_a_plugin_forks_does_not_outlive_its_step(tmp_path, monkeypatch):
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    options = [f"tiny_troubled.how=fork:{tmp_path / 'pid'}", "tiny.scenes=1"]
    planned = plan(replace(TINY, levels=[0.1, 0.2], options=options))
    worker = IsolatedWorker(planned.dataset, 1, LIMITS)
    try:
        statuses = [row["status"] for job in missing_jobs(planned, set()) for row in worker.rows(job)]
        deadline = time.monotonic() + 10
        while state((tmp_path / "pid").read_text()) not in ("gone", "Z") and time.monotonic() < deadline:
            time.sleep(0.05)
        assert state((tmp_path / "pid").read_text()) in ("gone", "Z")
    finally:
        worker.close()
    assert statuses == ["ok", "ok"]


def test_a_process_that_a_plugin_forked_and_ends_does_not_end_the_worker(run_rows):
    (row,) = run_rows("tiny_troubled.how=terminate", levels=[0.1]).values()
    assert (row["status"], row["error"], row["output"]) == ("ok", None, None)


def test_a_crash_that_an_earlier_cell_left_behind_costs_a_scene_no_cell(tmp_path, monkeypatch):
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    options = ["tiny_troubled.how=linger", "tiny.seconds=0.6", "tiny.scenes=2"]
    planned = plan(replace(TINY, levels=[0.1], options=options))
    worker = IsolatedWorker(planned.dataset, 1, LIMITS)
    try:
        first, other = missing_jobs(planned, set())
        assert [row["status"] for row in worker.rows(first) + worker.rows(other)] == ["ok", "ok"]
    finally:
        worker.close()


def test_setting_the_clock_ends_no_step(run_rows, monkeypatch):
    wall = time.time
    start = wall()
    monkeypatch.setattr(time, "time", lambda: wall() + 3600 * (wall() - start) // 1)
    rows = run_rows("tiny_fill.seconds=1.5", completers=["tiny_fill"], levels=[0.1])
    assert rows[0.1, "tiny_blind"]["status"] == "ok"


def state(pid):
    """One letter, as the kernel has it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "gone"


def test_a_limit_beyond_what_clocks_count_to_is_none(run_rows):
    rows = run_rows(levels=[0.1], limits=Limits(timeout_seconds=1e300))
    assert rows[0.1, "tiny_blind"]["status"] == "ok"


def test_memory_that_earlier_cells_left_behind_is_not_held_against_a_cell(run_rows):
    rows = run_rows(f"tiny_troubled.how={','.join(['hoard'] * 6)}", levels=TENTHS[:6])
    assert [row["status"] for row in rows.values()] == ["ok"] * 6, "0.2 GB each, together twice the limit"


def gone_soon(pid):
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def test_a_worker_that_closes_while_it_is_stopped_does_not_end_the_run(monkeypatch):
    class Closing(IsolatedWorker):
        pids: ClassVar = [1_000_000_000]
        _pid = property(lambda self: self.pids.pop() if self.pids else 0, lambda self, pid: None)

    ended = []
    monkeypatch.setattr("pcdbench.runner.isolated.end_group", ended.append)
    Closing(plan(TINY).dataset, 1, LIMITS).stop()
    assert ended == [1_000_000_000]


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"timeout_seconds": 0}, "--timeout 0 must be"),
        ({"timeout_seconds": float("nan")}, "--timeout nan must be"),
        ({"memory_gb": 0}, "--memory-limit 0 must be"),
        ({"retries": -1}, "--retries -1 must be"),
    ],
)
def test_limits_that_nothing_can_keep(limits, message):
    with pytest.raises(PcdbenchError, match=message):
        Limits(**limits)
