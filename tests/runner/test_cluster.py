"""Cells on Dask: the rows of local workers, whatever becomes of its workers, and models loaded once each."""

from __future__ import annotations

import os
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from outcomes_for_tests import outcomes
from typer.testing import CliRunner

from pcdbench.cli import app
from pcdbench.errors import PcdbenchError
from pcdbench.plugins import registry
from pcdbench.runner import cluster as cluster_module
from pcdbench.runner import cluster_worker
from pcdbench.runner.cluster import DaskCluster, dask_cluster
from pcdbench.runner.jobs import Job, Limits
from pcdbench.runner.plan import Plan, Request, plan
from pcdbench.runner.run import carry_out, local_processes
from pcdbench.testing import small_room

FOLDER = Path(__file__).parents[1] / "counted"
COUNTED = Request(
    ["counted_nothing"],
    ["counted_size"],
    "counted_rooms",
    references=False,
    options=["counted_nothing.seconds=0.05"],
)


@pytest.fixture(scope="module")
def counted_plugins() -> Iterator[None]:
    """The plugins of tests/counted, installed for these tests and all processes that they start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)
        patch.setenv("PYTHONPATH", str(FOLDER))
        registry.cache_clear()
        yield
    registry.cache_clear()


@pytest.fixture(scope="module")
def two_workers(counted_plugins: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PCDBENCH_CACHE", str(tmp_path_factory.mktemp("dask") / "cache"))
        with dask_cluster(workers=2) as cluster:
            yield cluster


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What local workers compute they compute anew."""
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))


def jobs_of(planned: Plan) -> list[Job]:
    return [Job(cell, planned.tasks) for cell in planned.cells]


def test_one_worker_two_workers_and_dask_give_the_same_values_bit_for_bit(
    two_workers: DaskCluster, tmp_path: Path
) -> None:
    scans = tmp_path / "scans"
    scans.mkdir()
    for number in range(2):
        small_room(seed=number).dense.write(scans / f"room{number}.ply")
    request = Request(
        ["plane_fitting", "hole_filling"],
        ["chamfer", "ssim", "localization"],
        f"clouds:{scans}",
        levels=[0.3],
        options=["clouds.complete_points=1500"],
    )
    planned = plan(request)
    places = {"one": local_processes(1), "two": local_processes(2), "dask": two_workers}
    found = {}
    for name, place in places.items():
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("PCDBENCH_CACHE", str(tmp_path / f"cache of {name}"))
            ended = carry_out(planned, tmp_path / name, place)
        assert not ended.failed
        found[name] = outcomes(ended.rows)
    assert len(found["one"]) == 2 * 5 * 3
    assert found["one"] == found["two"] == found["dask"]


def test_models_are_loaded_once_a_worker_and_scenes_stay_with_theirs(two_workers: DaskCluster, tmp_path: Path) -> None:
    log = tmp_path / "log"
    options = [*COUNTED.options, f"counted_nothing.log={log}", f"counted_rooms.log={log}"]
    ended = carry_out(plan(replace(COUNTED, options=options)), tmp_path / "run", two_workers)
    assert len(ended.rows) == 12 and not ended.failed
    made = Counter(line.split()[0] for line in log.read_text().splitlines())
    processes = {line.split()[1] for line in log.read_text().splitlines()}
    assert made["completer"] == len(processes) <= 2
    assert sum(made.values()) - made["completer"] <= 4 + 1, "only the last scene is shared"


def test_a_worker_killed_in_mid_run_costs_nothing_but_its_time(two_workers: DaskCluster, tmp_path: Path) -> None:
    planned = plan(replace(COUNTED, options=["counted_nothing.seconds=0.2", "counted_rooms.scenes=5"]))
    results = two_workers.run(jobs_of(planned), planned.dataset)
    first = next(results)
    pid = sorted(two_workers.client.run(os.getpid).values())[0]
    os.kill(pid, signal.SIGKILL)
    rows = [row for _, rows in [first, *results] for row in rows]
    assert {row["status"] for row in rows} == {"ok"}
    assert sorted(row["cell"] for row in rows) == sorted(cell.key for cell in planned.cells)


def test_few_jobs_are_sent_ahead_and_a_run_that_is_stopped_leaves_nothing_behind(two_workers: DaskCluster) -> None:
    two_workers.client.wait_for_workers(2)
    planned = plan(replace(COUNTED, options=["counted_rooms.scenes=20"]))
    results = two_workers.run(jobs_of(planned), planned.dataset)
    for _ in range(10):
        next(results)
        states = list(two_workers.client.futures.values())
        assert sum(state.status == "pending" for state in states) <= 2 * 2, "two a worker; done ones go in their time"
    results.close()
    assert set(two_workers.client.run(lambda: len(cluster_worker._places)).values()) == {0}


def test_a_job_that_comes_after_its_run_has_ended_starts_no_process() -> None:
    planned = plan(Request(["plane_fitting"], ["chamfer"]))
    cluster_worker.end_run("ended already")
    assert cluster_worker.do_job("ended already", planned.dataset, Limits(), jobs_of(planned)[0]) == []
    assert "ended already" not in cluster_worker._places


def test_a_worker_with_other_code_ends_the_run(two_workers: DaskCluster, tmp_path: Path) -> None:
    planned = plan(COUNTED)
    other = replace(planned, completers=(replace(planned.completers[0], code="of yesterday"),))
    with pytest.raises(PcdbenchError, match="has other code of completer 'counted_nothing'"):
        carry_out(other, tmp_path / "run", two_workers)


def test_without_dask_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(PcdbenchError, match=r"pip install 'pcdbench\[dask\]'"), dask_cluster():
        pass


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster_module, "_CONNECTING_SECONDS", 1)
    silent = "tcp://127.0.0.1:9"
    with pytest.raises(PcdbenchError, match=f"no Dask scheduler answers at {silent}"), dask_cluster(silent):
        pass


@pytest.mark.parametrize(
    ("address", "problem"),
    [
        ("tls://127.0.0.1:9", "TypeError: TLS expects a `ssl_context` .*"),
        ("head", "ValueError: missing port number in address 'head'"),
    ],
)
def test_an_address_that_cannot_be_used_is_one_line_that_says_why(address: str, problem: str) -> None:
    with pytest.raises(PcdbenchError, match=rf"^no Dask scheduler answers at {address} \({problem}\); start one"):
        dask_cluster(address).__enter__()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--scheduler", "tcp://head:8786"], "--scheduler needs --executor dask"),
        (
            ["--executor", "dask", "--scheduler", "tcp://head:8786", "--jobs", "2"],
            "--jobs does not go with --scheduler",
        ),
        (["--executor", "dask", "--jobs", "0"], "--jobs 0 must be at least 1"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    counted_plugins: None, tmp_path: Path, options: list[str], message: str
) -> None:
    command = ["run", "--completer", "counted_nothing", "--task", "counted_size", "--dataset", "counted_rooms"]
    result = CliRunner().invoke(app, [*command, "--out", str(tmp_path / "run"), *options])
    assert result.exit_code == 2 and message in result.stderr
