"""`pcdbench run` and `pcdbench results` as a user runs them: killed, interrupted, resumed, misused."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from outcomes_for_tests import outcomes
from typer.testing import CliRunner

from pcdbench.cli import app
from pcdbench.cloud import PointCloud
from pcdbench.leaderboard.figures import write_case_picture
from pcdbench.leaderboard.results import rows_of_run
from pcdbench.runner.completions import CompletionCache
from pcdbench.runner.execute import Executor
from pcdbench.runner.plan import Request, plan

COMMAND = [sys.executable, "-c", "from pcdbench.cli import main; main()"]
TINY = ["--dataset", "tiny", "--incompleteness", "slab", "--jobs", "1"]
SLOW = ["run", "--completer", "tiny_fill", "--task", "tiny_gap", *TINY, "--option", "tiny_fill.seconds=0.4"]


@pytest.fixture
def run(tmp_path, tiny_plugins, monkeypatch):
    """A function that runs a command in an empty folder with a cache of its own."""
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)

    def command(*arguments, code=0):
        monkeypatch.setattr(sys, "argv", ["pcdbench", *arguments])
        ended = CliRunner().invoke(app, arguments)
        assert ended.exit_code == code, (ended.stderr, ended.exception)
        return ended

    return command


def outcome(folder: Path) -> dict:
    rows = [json.loads(line) for line in (folder / "rows.jsonl").read_text().splitlines()]
    assert len({row["key"] for row in rows}) == len(rows), "no cell ran twice"
    return outcomes(rows)


def started(folder: Path, tmp_path: Path, rows: int) -> subprocess.Popen:
    """A slow run in mid-course: it has added as many rows, and more are to come."""
    path = folder / "rows.jsonl"
    wanted = rows + (path.read_bytes().count(b"\n") if path.exists() else 0)
    process = subprocess.Popen(
        [*COMMAND, *SLOW, "--out", str(folder)], cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    deadline = time.monotonic() + 240
    while time.monotonic() < deadline and process.poll() is None:
        if path.exists() and path.read_bytes().count(b"\n") >= wanted:
            return process
        time.sleep(0.02)
    process.kill()
    pytest.fail(f"the run did not get under way: {process.stderr.read()}")


def test_killed_and_interrupted_runs_are_taken_up_and_give_the_same_rows(run, tmp_path):
    folder, whole = tmp_path / "killed", tmp_path / "whole"
    killed = started(folder, tmp_path, rows=3)
    os.kill(killed.pid, signal.SIGSTOP)  # else a slow machine may find the run ended, and its folder free
    second = run(*SLOW, "--out", str(folder), code=2)
    assert second.stderr.startswith(f"pcdbench: {folder} is in use by another pcdbench; ")
    os.kill(killed.pid, signal.SIGKILL)
    killed.wait()
    with (folder / "rows.jsonl").open("ab") as stream:
        stream.write(b'{"schema_version": 1, "key": "to')

    interrupted = started(folder, tmp_path, rows=4)
    before = time.monotonic()
    os.killpg(interrupted.pid, signal.SIGINT)  # as a terminal does: workers are interrupted, too
    _, errors = interrupted.communicate(timeout=30)
    assert time.monotonic() - before < 30
    assert interrupted.returncode == 130 and "Traceback" not in errors
    assert "the same command goes on from there" in errors
    rows = outcome(folder)
    assert 7 <= len(rows) < 36

    run(*SLOW, "--out", str(folder))
    shutil.rmtree(tmp_path / "cache")
    run(*SLOW, "--out", str(whole))
    assert len(outcome(whole)) == 36
    assert outcome(folder) == outcome(whole)


def test_interrupted_while_it_still_imports_it_ends_in_one_line(tmp_path):
    (tmp_path / "typer.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    ended = subprocess.run(
        [sys.executable, "-m", "pcdbench", "list"],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert (ended.returncode, ended.stderr) == (130, "pcdbench: stopped\n")


def test_interrupted_while_its_workers_still_import_it_ends_in_one_line(tmp_path, tiny_plugins):
    process = subprocess.Popen(
        [*COMMAND, *SLOW, "--out", "run"], cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    while process.poll() is None and not _has_children(process.pid):
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors == "pcdbench: stopped; finished cells are stored, and the same command goes on from there\n"


def _has_children(pid: int) -> bool:
    return any(children.read_text() for children in Path(f"/proc/{pid}/task").glob("*/children"))


def test_a_limit_reaches_the_workers_and_the_reason_is_shown(run):
    arguments = ["--completer", "tiny_troubled", "--task", "tiny_blind", "--level", "0.1", "--format", "json"]
    options = ["--option", "tiny.scenes=1", "--option", "tiny_troubled.how=leak", "--memory-limit", "0.6"]
    ended = run("run", *arguments, *options, *TINY, "--out", "run", code=3)
    assert "1 rows failed; the same command tries them again" in ended.stderr
    (reason,) = json.loads(ended.stdout)["reasons"]
    assert "its worker took more than 0.6 GB of memory (--memory-limit)" in reason


def test_a_completer_that_crashed_is_not_run_again_to_draw_it(run, tmp_path):
    arguments = ["--completer", "tiny_troubled", "--task", "tiny_gap", "--option", "tiny_troubled.how=crash"]
    run("run", *arguments, "--option", "tiny.scenes=1", "--level", "0.1", *TINY, "--out", "run", code=3)
    assert (tmp_path / "run" / "case_box0_0.1.png").exists()


def test_warnings_of_workers_are_one_line_each_and_prints_do_not_show(run, tmp_path, capfd):
    (tmp_path / "cache").write_text("no folder")
    arguments = ["--completer", "tiny_troubled", "--task", "tiny_gap", "--option", "tiny_troubled.how=warn,warn"]
    run("run", *arguments, "--option", "tiny.scenes=1", "--level", "0.1,0.2", *TINY, "--out", "run")
    lines = capfd.readouterr().err.splitlines()
    assert lines.count("pcdbench: a scan is odd") == 1
    assert sum("completed clouds are not kept: " in line for line in lines) == 1
    assert not [line for line in lines if "warnings.warn" in line or "about to" in line or "is old" in line]


@pytest.fixture
def small_disk(tmp_path) -> Path:
    """A disk of 40 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = (
        shutil.which("mount")
        and not subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=40k", "tmpfs", disk], capture_output=True
        ).returncode
    )
    if not mounted:
        pytest.skip("disks can be mounted by root alone")
    yield disk
    subprocess.run(["umount", "-l", disk], check=True)


def test_a_full_disk_ends_the_run_in_one_line_and_nothing_is_lost(run, tmp_path, small_disk):
    arguments = ["run", "--completer", "tiny_fill", "--task", "tiny_gap", *TINY]
    ended = run(*arguments, "--out", str(small_disk / "run"), code=2)
    path = small_disk / "run" / "rows.jsonl"
    assert ended.stderr.splitlines()[-1] == (
        f"pcdbench: {path} cannot be written (No space left on device); all cells before are stored: "
        "make room there and give the same command again"
    )
    before = path.read_bytes()
    assert 0 < len(outcome(small_disk / "run")) < 36 and before.endswith(b"\n")
    subprocess.run(["mount", "-o", "remount,size=1m", small_disk], check=True)
    run(*arguments, "--out", str(small_disk / "run"))
    assert path.read_bytes().startswith(before)
    run(*arguments, "--out", "whole")
    assert outcome(small_disk / "run") == outcome(tmp_path / "whole")


def test_a_table_that_no_disk_takes_is_one_line(tiny_plugins):
    with open("/dev/full", "w") as full:
        ended = subprocess.run([*COMMAND, "list"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 2
    assert ended.stderr == "pcdbench: what is printed cannot be written (No space left on device); make room there\n"


def test_names_that_are_given_one_by_one_all_count(run, tmp_path):
    tiny = [*TINY, "--option", "tiny.scenes=1"]
    run("run", "--completer", "tiny_fill,incomplete", "--task", "tiny_gap,tiny_blind", "--level", "0.1,0.2", *tiny)
    (together,) = (tmp_path / "runs").iterdir()
    one_by_one = ["--completer", "tiny_fill", "--completer", "incomplete", "--task", "tiny_gap", "--task", "tiny_blind"]
    assert "rows:" in run("run", *one_by_one, "--level", "0.1", "--level", "0.2", *tiny).stderr
    assert list((tmp_path / "runs").iterdir()) == [together] and len(outcome(together)) > 0


def test_a_terminal_without_utf8_gets_escapes(tmp_path, run):
    arguments = ["--completer", "tiny_fill", "--task", "tiny_gap", "--level", "0.1", "--option", "tiny.scenes=1"]
    run("run", *arguments, *TINY, "--out", "küche")
    path = tmp_path / "küche" / "run.json"
    path.write_text(path.read_text(encoding="utf-8").replace('"command": "', '"command": "küche '), encoding="utf-8")
    ascii_alone = os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    ended = subprocess.run([*COMMAND, "results", "küche"], env=ascii_alone, capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "") and r"tiny_gap \xb7 gap_m" in ended.stdout


def test_what_is_opened_takes_no_closed_streams_place_here_or_in_a_child():
    script = """
import os, subprocess, sys
from pcdbench import __main__

sys.argv = ["pcdbench", "--version"]
try:
    __main__.main()
except SystemExit:
    assert os.open(os.devnull, os.O_RDONLY) > 2
    subprocess.run([sys.executable, "-c", "import os; os.dup(1)"], check=True)
"""
    subprocess.run(["sh", "-c", '"$@" >&-', "sh", sys.executable, "-c", script], check=True)


def test_the_same_command_finds_its_folder_and_does_only_what_is_missing(run, tmp_path):
    arguments = ["run", "--completer", "tiny_fill", "--task", "tiny_gap,tiny_color", *TINY]
    first = run(*arguments)
    (folder,) = (tmp_path / "runs").iterdir()
    assert f"rows: runs/{folder.name}/rows.jsonl" in first.stderr
    assert (folder / "case_box0_0.3.png").stat().st_size > 5000
    assert f"one case side by side: runs/{folder.name}/case_box0_0.3.png" in first.stderr
    rows = (folder / "rows.jsonl").read_bytes()
    again = run(*arguments)
    assert (folder / "rows.jsonl").read_bytes() == rows
    assert again.stdout == first.stdout
    assert run("results", str(folder)).stdout == first.stdout

    provenance = json.loads((folder / "run.json").read_text())
    assert provenance["configuration"]["completers"][-1]["options"] == {"points": 500, "seconds": 0.0}
    assert {"numpy", "pcdbench", "tiny-plugins"} <= provenance["packages"].keys()
    assert provenance["machine"]["cores"] >= 1 and "--completer tiny_fill" in provenance["command"]


def test_failures_are_counted_and_shown_in_every_format(run, tmp_path):
    arguments = ["--completer", "tiny_faulty,tiny_fill", "--task", "tiny_gap", "--option", "tiny_faulty.level=0.4"]
    ended = run("run", *arguments, *TINY, "--figures", "--out", "run", "--format", "json", code=3)
    assert "3 rows failed; the same command tries them again" in ended.stderr
    reason = "3 failed: tiny_faulty on tiny_gap: ZeroDivisionError: no plane has been found"
    content = json.loads(ended.stdout)
    lines = content["summary"]
    assert content["reasons"] == [reason]
    assert len(lines) == 5 * 3 * 2 - 1, "the level at which nothing was measured has one line, without a metric"
    for line in lines:
        faulty = (line["completer"], line["level"]) == ("tiny_faulty", 0.5)
        assert (line["cases"], line["failed"]) == ((0, 3) if faulty else (3, 0))
        assert line["median"] is None if faulty else line["median_low"] <= line["median"] <= line["median_high"]

    table = list(csv.DictReader(run("results", "run", "--format", "csv").stdout.splitlines()))
    assert [(line["completer"], line["metric"]) for line in lines] == [
        (its["completer"], its["metric"]) for its in table
    ]
    page = run("results", "run", "--format", "markdown").stdout
    assert "### tiny_gap · gap_m (m; lower is better) · slab" in page and f"- {reason}" in page
    assert sum("**" in line for line in page.splitlines()) == 3
    shown = run("results", "run").stdout
    assert "0 (3 failed)" in shown and reason in shown

    assert "figures: 1 in run/figures" in ended.stderr
    assert (tmp_path / "run" / "figures" / "tiny_gap_by_level.png").stat().st_size > 1000


def test_several_seeds_are_one_document_for_programs(run, tmp_path):
    (tmp_path / "suite.toml").write_text(
        'dataset = "tiny"\nincompletenesses = ["slab"]\nlevels = [0.3]\ncompleters = ["tiny_fill"]\n'
        'tasks = ["tiny_gap"]\nseeds = [0, 7]\n'
    )
    folders = ["two/1", "two/2"]
    ended = run("run", "suite.toml", "--out", "two", "--format", "json")
    content = json.loads(ended.stdout)
    assert [its["run"] for its in content] == folders
    assert content[0] == json.loads(run("results", "two/1", "--format", "json").stdout)
    assert [f"rows: {folder}/rows.jsonl" in ended.stderr for folder in folders] == [True, True]
    table = list(csv.DictReader(run("run", "suite.toml", "--out", "two", "--format", "csv").stdout.splitlines()))
    assert [line["run"] for line in table] == [its["run"] for its in content for _ in its["summary"]]
    assert [line["completer"] for line in table] == [line["completer"] for its in content for line in its["summary"]]
    pages = run("run", "suite.toml", "--out", "two", "--format", "markdown").stdout
    assert pages == "".join(run("results", folder, "--format", "markdown").stdout for folder in folders)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--option", "tiny_fill.point=3"], "tiny_fill has no option 'point'; did you mean points?"),
        (["--option", "tiny_fill.points=x"], "--option tiny_fill.points=x: input should be a valid integer"),
        (["--option", "ssim.x=1"], "'ssim' is not in this run"),
        (["--level", "a"], "--level 'a' must be numbers between 0 and 1"),
        (["--level", "30"], "--level 30 must lie between 0 and 1"),
        (["--jobs", "0"], "--jobs 0 must be at least 1"),
        (["--timeout", "0"], "--timeout 0 must be a number of seconds above 0"),
        (["--memory-limit", "0"], "--memory-limit 0 must be a number of GB above 0"),
        (["--retries", "-1"], "--retries -1 must be 0 or more"),
        (["--split", "none"], "split 'none' of data set 'tiny' has no scenes"),
    ],
)
def test_misuse_is_one_line_and_exit_code_2(run, arguments, message):
    ended = run("run", "--completer", "tiny_fill", "--task", "tiny_gap", *TINY, *arguments, code=2)
    assert message in ended.stderr
    assert sum(line.startswith("pcdbench: ") for line in ended.stderr.splitlines()) == 1


def test_a_run_that_measured_nothing_says_why_and_exits_with_2(run, tmp_path):
    arguments = ["--completer", "tiny_fill", "--task", "tiny_gap", "--dataset", "tiny", "--jobs", "1"]
    ended = run("run", *arguments, "--incompleteness", "real_pair", "--out", "run", code=2)
    assert ended.stderr.splitlines()[-1].startswith(
        "pcdbench: nothing was measured: all 12 rows were skipped, the first as box0 has no incomplete scan"
    )
    assert "12 skipped: ground_truth, incomplete, resample, tiny_fill on tiny_gap" in ended.stdout


def test_results_of_several_runs_names_them(run, tmp_path):
    for name in ("b", "a", "notes"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        if name != "notes":
            (tmp_path / "runs" / name / "run.json").write_text('{"schema_version": 1}')
    ended = run("results", "runs", code=2)
    assert ended.stderr == "pcdbench: runs is not a run but holds some: runs/a, runs/b; give one of them\n"


def test_results_of_what_is_no_run(run, tmp_path):
    assert "is not a run" in run("results", str(tmp_path), code=2).stderr


def test_results_of_a_file_names_the_folders_to_look_in(run, tmp_path):
    (tmp_path / "notes").write_text("no run")
    assert "notes is not a run: it has no run.json" in run("results", "notes", code=2).stderr


def test_one_case_is_drawn_unless_its_scan_is_gone(run, tmp_path):
    points = np.random.default_rng(0).uniform(0, 4, (200, 3))
    PointCloud(points).write(tmp_path / "scans" / "room.npz")
    arguments = ["run", "--completer", "tiny_fill", "--task", "tiny_gap", "--jobs", "1", "--level", "0.3"]
    planned = plan(Request(["tiny_fill"], ["tiny_gap"], f"clouds:{tmp_path / 'scans'}", levels=[0.3]))
    run(*arguments, "--dataset", "clouds:scans", "--out", "run")
    rows = rows_of_run(tmp_path / "run")
    assert write_case_picture(planned, rows, tmp_path / "drawn") == tmp_path / "drawn" / "case_room_0.3.png"
    (tmp_path / "scans" / "room.npz").write_bytes(b"damaged")
    assert write_case_picture(planned, rows, tmp_path / "drawn") is None


@pytest.mark.usefixtures("tiny_plugins")
def test_a_case_that_could_not_be_made_is_not_made_again_to_be_drawn(tmp_path, monkeypatch):
    options = ["tiny.scenes=1", "troubled_slab.how=raise"]
    ways = ["troubled_slab", "slab"]
    planned = plan(Request(["tiny_fill"], ["tiny_gap"], "tiny", None, ways, [0.1], options=options, references=False))
    executor = Executor(planned.dataset, CompletionCache(tmp_path))
    rows = [row for cell in planned.cells for row in executor.rows(cell, planned.tasks)]
    assert [row["stage"] for row in rows] == ["case", None]
    done = []
    monkeypatch.setattr("tiny_plugins.misbehave", done.append)
    assert write_case_picture(planned, rows, tmp_path / "drawn") is not None
    assert "raise" not in done, "what ended a worker would end this process"


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("run.json", "[]", "run.json cannot be read"),
        ("run.json", "{", "run.json cannot be read"),
        ("rows.jsonl", '{"lock": "a"}\n', "rows.jsonl, line 1, is damaged"),
        ("rows.jsonl", "7\n", "rows.jsonl, line 1, is damaged"),
        ("rows.jsonl", "", "has no rows yet"),
    ],
)
def test_results_of_a_damaged_run_name_the_file(run, tmp_path, file, text, message):
    (tmp_path / "run.json").write_text('{"schema_version": 1}')
    (tmp_path / file).write_text(text)
    assert message in run("results", ".", code=2).stderr
