"""Worker processes: the same rows from any number of them, crashes that cost one cell, and what is missing only."""

import errno
from dataclasses import replace

import pytest
from executor_for_tests import InThisProcess
from outcomes_for_tests import outcomes

from pcdbench.errors import PcdbenchError
from pcdbench.runner import isolated
from pcdbench.runner.jobs import Job, JobQueue
from pcdbench.runner.plan import Request, plan
from pcdbench.runner.progress import RemainingTime, duration
from pcdbench.runner.run import carry_out, local_processes
from pcdbench.runner.store import read_run

pytestmark = pytest.mark.usefixtures("tiny_plugins")
TINY = Request(["tiny_fill"], ["tiny_gap", "tiny_color"], "tiny", None, ["slab"], references=False)


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))


def test_any_number_of_workers_gives_the_same_rows(tmp_path, monkeypatch):
    planned = plan(replace(TINY, references=True))
    alone = carry_out(planned, tmp_path / "one", local_processes(1))
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache2"))
    together = carry_out(planned, tmp_path / "two", local_processes(2))
    assert len(alone.rows) == 3 * 3 * 4 * 2
    assert outcomes(alone.rows) == outcomes(together.rows)
    assert {row["completing"]["cached"] for row in together.rows} == {False}
    assert carry_out(planned, tmp_path / "two", local_processes(2)).new_cells == 0


def test_a_crash_costs_its_own_cell_and_the_rest_goes_on(tmp_path):
    request = replace(TINY, completers=["tiny_faulty", "tiny_fill"])
    planned = plan(replace(request, options=["tiny_faulty.how=crash", "tiny_faulty.level=0.4", "tiny.scenes=2"]))
    ended = carry_out(planned, tmp_path / "run", local_processes(2))
    assert len(ended.rows) == 2 * 3 * 2 * 2
    failed = {(row["completer"]["name"], row["level"], row["status"], row["stage"]) for row in ended.failed}
    assert failed == {("tiny_faulty", 0.5, "failed", "completing")}
    assert len(ended.failed) == 4 and "died of SIGSEGV" in ended.failed[0]["error"]


def test_failed_rows_are_tried_again_and_others_are_not(tmp_path):
    mark = tmp_path / "mark"
    options = ["tiny_faulty.how=once", f"tiny_faulty.mark={mark}", "tiny.scenes=1"]
    planned = plan(replace(TINY, completers=["tiny_faulty", "tiny_fill"], options=options))
    first = carry_out(planned, tmp_path / "run", local_processes(1))
    assert (first.new_cells, len(first.failed)) == (6, 6)
    mark.touch()
    second = carry_out(planned, tmp_path / "run", local_processes(1))
    assert (second.new_cells, len(second.failed), len(second.rows)) == (3, 0, 12)


def test_a_run_says_which_machine_measured_its_rows(tmp_path, monkeypatch):
    mark = tmp_path / "mark"
    options = ["tiny_faulty.how=once", f"tiny_faulty.mark={mark}", "tiny.scenes=1"]
    planned = plan(replace(TINY, completers=["tiny_faulty", "tiny_fill"], options=options))

    def facts(host, calibration):
        monkeypatch.setattr("platform.node", lambda: host)
        monkeypatch.setattr("pcdbench.runner.run.provenance", lambda: {"machine": {"cpu": f"that of {host}"}})
        monkeypatch.setattr("pcdbench.runner.run.calibration_seconds", lambda: calibration)
        ended = carry_out(planned, tmp_path / "run", InThisProcess())
        told = read_run(tmp_path / "run")
        by_host = {told["host"]: told} | told.get("elsewhere", {})
        found = {of: (its["machine"]["cpu"], its["calibration_seconds"]) for of, its in by_host.items()}
        return found, {row["host"] for row in ended.rows}

    assert facts("a", 1.0) == ({"a": ("that of a", 1.0)}, {"a"})
    assert facts("a", 2.0) == ({"a": ("that of a", 2.0)}, {"a"}), "what failed was tried again"
    mark.touch()
    both = {"a": ("that of a", 2.0), "b": ("that of b", 3.0)}
    assert facts("b", 3.0) == (both, {"a", "b"})
    assert facts("c", 4.0) == facts("a", 5.0) == (both, {"a", "b"}), "there was nothing left to measure"


def test_not_one_usable_scene_is_an_error_that_names_the_first(tmp_path):
    planned = plan(replace(TINY, options=["tiny.broken=all"]))
    with pytest.raises(PcdbenchError, match=r"no scene of tiny can be used: box\d \(and 2 more\): .*scan it again"):
        carry_out(planned, tmp_path / "run", local_processes(1))


def test_no_workers_is_an_error(tmp_path):
    with pytest.raises(PcdbenchError, match="--jobs 0"):
        carry_out(plan(TINY), tmp_path / "run", local_processes(0))


@pytest.mark.parametrize("lacking", ["Output", "ProcessPool"])
def test_workers_that_the_system_refuses_are_one_line(tmp_path, monkeypatch, lacking):
    def refuse(*arguments, **named):
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(isolated, lacking, refuse)
    with pytest.raises(PcdbenchError, match=r"cannot be started \(Too many open files\); give fewer --jobs"):
        carry_out(plan(TINY), tmp_path / "run", local_processes(2))


def test_workers_limit_their_threads(tmp_path):
    planned = plan(replace(TINY, options=["tiny.scenes=1"], levels=[0.1]))
    jobs = [Job(cell, planned.tasks) for cell in planned.cells]
    ((_, rows),) = local_processes(64).run(jobs, planned.dataset)
    assert {row["threads"] for row in rows} == {1}


def test_a_worker_stays_with_its_scene_then_helps_with_the_longest():
    planned = plan(replace(TINY, completers=["tiny_fill", "tiny_colorful"], options=["tiny.scenes=2"]))
    queue = JobQueue([Job(cell, planned.tasks) for cell in planned.cells])
    fast, slow = [queue.take("fast").cell], [queue.take("slow").cell]
    fast += [queue.take("fast").cell for _ in range(7)]
    assert [cell.scene for cell in fast] == ["box0"] * 6 + ["box1"] * 2
    assert [cell.scene for cell in slow] == ["box1"]
    levels = [cell.level for cell in fast[:6]]
    assert levels == sorted(levels), "cells of a case follow one another"
    rest = [queue.take("slow").cell for _ in range(3)]
    assert queue.take("slow") is None
    assert {cell.key for cell in [*fast, *slow, *rest]} == {cell.key for cell in planned.cells}


def test_time_left_counts_each_completer_at_its_own_pace():
    planned = plan(replace(TINY, completers=["tiny_fill", "tiny_colorful"], options=["tiny.scenes=2"]))
    jobs = [Job(cell, planned.tasks) for cell in planned.cells]
    remaining = RemainingTime(jobs, workers=1)
    elapsed = 0.0
    for job in jobs[:4]:
        elapsed += 10.0 if job.cell.completer.name == "tiny_fill" else 1.0
        remaining.done(job, elapsed)
    assert remaining.seconds() == pytest.approx(4 * 10 + 4 * 1)


def test_durations_for_people():
    assert [duration(seconds) for seconds in (0.4, 59.6, 3599, 7500)] == [
        "0 s",
        "1 min 0 s",
        "59 min 59 s",
        "2 h 5 min",
    ]
