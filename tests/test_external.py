"""Completers outside of this interpreter: programs of their own, and clouds that were completed elsewhere."""

import copy
import errno
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import pcdbench
from pcdbench import Case, CommandCompleter, FolderCompleter, PcdbenchError, PluginError, PointCloud, Skipped
from pcdbench.cli import app
from pcdbench.external import cloud_tag
from pcdbench.leaderboard.board_file import read_board
from pcdbench.leaderboard.page_data import page_payload
from pcdbench.plugins import registry
from pcdbench.testing import check_completer

# A method as it may lie somewhere: it knows nothing of pcdbench, and files of text are all that it reads.
METHOD = """
import os, random, sys

def complete(incomplete, completed, seed):
    random.seed(int(seed))
    rows = [line.split() for line in open(incomplete) if line.strip()]
    moved = [[str(float(x) + 0.25), y, str(float(z) + random.random()), *rest] for x, y, z, *rest in rows]
    with open(completed, "w") as stream:
        stream.writelines(" ".join(row) + "\\n" for row in rows + moved)
"""
ONCE = METHOD + "complete(*sys.argv[1:])\n"
STAYS = (
    METHOD
    + """
print("loading", os.getpid(), flush=True)
for line in sys.stdin:
    complete(*line.rstrip("\\n").split("\\t"))
    print("done", flush=True)
"""
)
FILES = ("{incomplete}", "{completed}", "{seed}")


@pytest.fixture
def program(tmp_path: Path) -> Callable[..., type[CommandCompleter]]:
    """A completer whose program is this text: `(text, *arguments, **attributes)`."""

    def made(text: str, *arguments: str, **attributes: Any) -> type[CommandCompleter]:
        path = tmp_path / "method.py"
        path.write_text(text)
        own = {"command": (sys.executable, str(path), *arguments), "suffix": ".xyz", **attributes}
        return type("Mine", (CommandCompleter,), own)

    return made


def complete(completer: CommandCompleter | FolderCompleter, cloud: PointCloud, seed: int = 0) -> PointCloud:
    return completer.complete(cloud, np.random.default_rng(seed))


@pytest.mark.parametrize(("text", "arguments"), [(ONCE, FILES), (STAYS, ())], ids=["once", "stays"])
def test_a_program_is_a_completer(program: Callable, cloud: PointCloud, text: str, arguments: tuple[str, ...]) -> None:
    completed = complete(program(text, *arguments)(), cloud)
    assert len(completed) == 200
    np.testing.assert_allclose(completed.points[:100], cloud.points, atol=1e-5)
    np.testing.assert_allclose(completed.points[100:, :2], cloud.points[:, :2] + (0.25, 0.0), atol=1e-5)
    assert completed.colors is not None and cloud.colors is not None
    np.testing.assert_allclose(completed.colors[:100], cloud.colors, atol=1 / 255)


@pytest.mark.parametrize(("text", "arguments"), [(ONCE, FILES), (STAYS, ())], ids=["once", "stays"])
def test_it_keeps_the_contract(program: Callable, text: str, arguments: tuple[str, ...]) -> None:
    # Turned about the origin, map coordinates would lie far off.
    about_itself = text.replace("-float(x)", "2 * float(rows[0][0]) - float(x)").replace(
        "-float(y)", "2 * float(rows[0][1]) - float(y)"
    )
    check_completer(program(about_itself, *arguments))


def test_what_stays_is_started_once_and_ends_with_its_completer(
    program: Callable, cloud: PointCloud, capfd: pytest.CaptureFixture[str]
) -> None:
    completer = program(STAYS)()
    for _ in range(3):
        complete(completer, cloud)
    (started,) = [line for line in capfd.readouterr().err.splitlines() if line.startswith("loading")]
    pid = int(started.split()[1])
    os.kill(pid, 0)
    del completer
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_the_seed_decides(program: Callable, cloud: PointCloud) -> None:
    completer = program(ONCE, *FILES)()
    one, same, other = (complete(completer, cloud, seed).points for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("command", ["cp '{incomplete}' {completed}", [Path("/bin/cp"), "{incomplete}", "{completed}"]])
def test_a_command_may_be_one_text_and_hold_paths(cloud: PointCloud, command: Any) -> None:
    completer = type("Copies", (CommandCompleter,), {"command": command})()
    np.testing.assert_allclose(complete(completer, cloud).points, cloud.points, atol=1e-6)


FAILURES = {
    "raises": ("raise ValueError('no GPU')", FILES, PluginError, "exit code 1: ValueError: no GPU"),
    "killed": ("import os; os.kill(os.getpid(), 9)", FILES, PluginError, "ended by signal 9: it printed nothing"),
    "writes nothing": ("print('fine')", FILES, PluginError, "done, and wrote no completed.xyz"),
    "babbles": ("print('x' * 10**6); raise SystemExit(1)", FILES, PluginError, "exit code 1: x{500}$"),
    "skips": ("print('skipped: too few points')", FILES, Skipped, "^too few points$"),
    "ends": ("import sys; sys.stdin.readline(); 1 / 0", (), PluginError, "1 before it answered: ZeroDivisionError"),
    "never reads": ("1 / 0", (), PluginError, "1 before it answered: ZeroDivisionError"),
    "fails": ("input(); print('failed: no GPU')", (), PluginError, "failed: no GPU"),
    "skips, staying": ("input(); print('skipped: too few')", (), Skipped, "^too few$"),
    "lies": ("input(); print('done')", (), PluginError, "done, and wrote no completed.xyz"),
}


@pytest.mark.parametrize(("text", "arguments", "error", "message"), FAILURES.values(), ids=FAILURES)
def test_what_goes_wrong_is_one_line(
    program: Callable, cloud: PointCloud, text: str, arguments: tuple[str, ...], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message) as raised:
        complete(program(text, *arguments)(), cloud)
    assert len(str(raised.value).splitlines()) == 1


def other_frames(points: np.ndarray) -> dict[str, np.ndarray]:
    centered = points - points.mean(axis=0)
    return {
        "millimetres": 1000 * points,
        "normalised": centered / np.linalg.norm(centered, axis=1).max() / 2,
        "elsewhere": points + np.array([0.0, 30.0, 0.0]),
        "one point": points[:1],
    }


@pytest.mark.parametrize("frame", ["millimetres", "normalised", "elsewhere", "one point"])
def test_clouds_in_another_frame_are_not_measured(
    program: Callable, half_room: Case, tmp_path: Path, frame: str
) -> None:
    incomplete = half_room.cloud
    completed = PointCloud(other_frames(incomplete.points)[frame])
    completed.write(tmp_path / f"{cloud_tag(incomplete)}.npz")
    completed.write(tmp_path / f"completed-{cloud_tag(incomplete)}.npz")
    copies = program(
        f"import shutil, sys; shutil.copy({str(tmp_path / cloud_tag(incomplete))!r} + '.npz', sys.argv[2])",
        *FILES,
        suffix=".npz",
    )
    for completer in (FolderCompleter(FolderCompleter.Options(folder=str(tmp_path))), copies()):
        with pytest.raises(PluginError, match=r"m large and lies .*undo what the method normalises") as raised:
            complete(completer, incomplete)
        assert len(str(raised.value).splitlines()) == 1


def test_strays_do_not_make_it_another_frame(tmp_path: Path, half_room: Case) -> None:
    incomplete = half_room.cloud
    points = np.concatenate([incomplete.points, [(1e4, 0.0, 0.0)]])
    PointCloud(points).write(tmp_path / f"completed-{cloud_tag(incomplete)}.npz")
    completer = FolderCompleter(FolderCompleter.Options(folder=str(tmp_path)))
    assert len(complete(completer, incomplete)) == len(points)


@pytest.mark.parametrize("arguments", [FILES, ()], ids=["once", "stays"])
def test_a_program_that_is_not_there_is_named(cloud: PointCloud, arguments: tuple[str, ...]) -> None:
    class Missing(CommandCompleter):
        command = ("/nowhere/python", *arguments)

    with pytest.raises(PluginError, match=r"/nowhere/python cannot be started .*No such file"):
        complete(Missing(), cloud)


def test_a_completer_without_a_command_says_so(cloud: PointCloud) -> None:
    with pytest.raises(PluginError, match="CommandCompleter names no program"):
        complete(CommandCompleter(), cloud)


def test_after_one_death_it_is_started_again(program: Callable, cloud: PointCloud) -> None:
    dies_of_small_clouds = STAYS.replace(
        "complete(*line", "sum(1 for _ in open(line.split(chr(9))[0])) < 10 and 1 / 0; complete(*line"
    )
    completer = program(dies_of_small_clouds)()
    assert len(complete(completer, cloud)) == 200
    with pytest.raises(PluginError, match="ZeroDivisionError"):
        complete(completer, cloud.select(np.arange(5)))
    assert len(complete(completer, cloud)) == 200


def test_one_that_ended_after_it_answered_is_started_again(program: Callable, cloud: PointCloud) -> None:
    completer = program(STAYS.replace("flush=True)\n", "flush=True); os._exit(0)\n").replace("os._exit(0)", "", 1))()
    for _ in range(3):
        assert len(complete(completer, cloud)) == 200
        completer._program._process.wait(timeout=10)


def test_an_answer_too_many_is_not_taken_for_that_to_the_next_cloud(program: Callable, cloud: PointCloud) -> None:
    again = 'print("done", flush=True)\n    time.sleep(0.2); print("done", flush=True)\n'
    completer = program("import time\n" + STAYS.replace('print("done", flush=True)\n', again))()
    assert len(complete(completer, cloud)) == 200
    time.sleep(1.0)
    with pytest.raises(PluginError, match=r"answered twice to one cloud \(done\); let it print one answer, once the"):
        complete(completer, cloud)
    assert len(complete(completer, cloud)) == 200, "it was started again"


def test_one_that_says_too_early_that_it_is_done_is_started_again(program: Callable, cloud: PointCloud) -> None:
    early = STAYS.replace("for line in sys.stdin:\n", 'for line in sys.stdin:\n    print("done", flush=True)\n')
    completer = program("import time\n" + early.replace("    complete(", "    time.sleep(0.5); complete("))()
    for _ in range(3):
        with pytest.raises(PluginError, match=r"says that it is done, and wrote no completed\.xyz"):
            complete(completer, cloud)


def test_a_program_that_changes_meanwhile_is_not_measured_as_what_it_was(
    program: Callable, tmp_path: Path, cloud: PointCloud
) -> None:
    script = tmp_path / "method.py"
    completer = program(ONCE, *FILES, files=script)()
    completer.weights_digest()
    complete(completer, cloud)
    os.utime(script)
    complete(completer, cloud)
    script.write_text(ONCE + "# changed\n")
    with pytest.raises(PcdbenchError, match="the `files` of Mine have changed meanwhile; give the command again"):
        complete(completer, cloud)


def test_a_completed_cloud_that_changes_meanwhile_is_not_measured(tmp_path: Path, half_room: Case) -> None:
    path = tmp_path / f"it-{cloud_tag(half_room.cloud)}.ply"
    half_room.cloud.write(path)
    completer = FolderCompleter(FolderCompleter.Options(folder=str(tmp_path)))
    completer.weights_digest()
    complete(completer, half_room.cloud)
    half_room.cloud.select(slice(100)).write(path)
    with pytest.raises(PcdbenchError, match=r"\.ply has changed meanwhile; give the command again"):
        complete(completer, half_room.cloud)


def test_what_it_said_of_a_cloud_before_is_not_said_again(program: Callable, cloud: PointCloud) -> None:
    first = "input(); sys.stderr.write('fine'); sys.stderr.flush(); print('failed: it')"
    completer = program(f"import sys\n{first}\ninput(); sys.exit('no GPU')")()
    for message in (r"failed: it$", r"exit code 1 before it answered: no GPU$"):
        with pytest.raises(PluginError, match=message):
            complete(completer, cloud)


# It prints nothing, and keeps open what its parent prints to.
LEAVES_A_CHILD = "import subprocess; subprocess.Popen(['sleep', '8'])\n"
LEFT = {
    "done": (ONCE + LEAVES_A_CHILD, FILES, None),
    "fails": (LEAVES_A_CHILD + "raise SystemExit('no GPU')", FILES, "exit code 1: no GPU"),
    "dies": (LEAVES_A_CHILD + "raise SystemExit('no GPU')", (), "exit code 1 before it answered: no GPU"),
}


@pytest.mark.parametrize(("text", "arguments", "message"), LEFT.values(), ids=LEFT)
def test_what_it_leaves_running_is_not_waited_for(
    program: Callable, cloud: PointCloud, text: str, arguments: tuple[str, ...], message: str | None
) -> None:
    begun = time.monotonic()
    completer = program(text, *arguments)()
    if message is None:
        assert len(complete(completer, cloud)) == 200
    else:
        with pytest.raises(PluginError, match=message):
            complete(completer, cloud)
    assert time.monotonic() - begun < 6


def test_files_that_cannot_be_removed_cost_no_cloud(
    program: Callable, cloud: PointCloud, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(*_: object, **__: object) -> None:
        raise OSError(errno.ENOTEMPTY, "Directory not empty")

    monkeypatch.setattr("os.rmdir", refuses)
    assert len(complete(program(ONCE, *FILES)(), cloud)) == 200


def test_a_copy_starts_a_program_of_its_own(
    program: Callable, cloud: PointCloud, capfd: pytest.CaptureFixture[str]
) -> None:
    completer = program(STAYS)()
    first = complete(completer, cloud)
    # As it is handed to worker processes.
    other = copy.deepcopy(completer)
    np.testing.assert_array_equal(complete(other, cloud).points, first.points)
    complete(completer, cloud)
    assert len({line for line in capfd.readouterr().err.splitlines() if line.startswith("loading")}) == 2


def test_what_it_prints_neither_blocks_nor_answers(program: Callable, cloud: PointCloud) -> None:
    talks = STAYS.replace(
        "    print(", "    sys.stderr.write('x' * 300_000); sys.stdout.write('all is done\\n' * 30_000)\n    print("
    )
    completer = program(talks)()
    assert len(complete(completer, cloud)) == len(complete(completer, cloud)) == 200


def test_an_answer_that_was_not_waited_for_is_not_taken_for_the_next(
    program: Callable, cloud: PointCloud, monkeypatch: pytest.MonkeyPatch
) -> None:
    completer = program(STAYS)()
    complete(completer, cloud)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr("pcdbench.external._answer", interrupted)
        complete(completer, cloud)
    assert len(complete(completer, cloud)) == 200


def test_a_program_that_is_interrupted_is_not_waited_for(
    program: Callable, cloud: PointCloud, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pcdbench.external._printed", interrupted)
    completer = program("import time; time.sleep(60)")()
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        complete(completer, cloud)
    assert time.monotonic() - begun < 2


@pytest.mark.parametrize("variable", ["OMP_NUM_THREADS", "PCDBENCH_THREADS"])
def test_it_has_our_threads_and_not_our_python(
    program: Callable, cloud: PointCloud, monkeypatch: pytest.MonkeyPatch, variable: str
) -> None:
    monkeypatch.setenv("PYTHONPATH", "/ours")
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv(variable, "3")
    tells = "import os; raise SystemExit(' '.join([os.environ['OMP_NUM_THREADS'], str(os.environ.get('PYTHONPATH'))]))"
    with pytest.raises(PluginError, match="exit code 1: 3 None"):
        complete(program(tells, *FILES)(), cloud)


def test_other_files_are_other_weights(program: Callable, tmp_path: Path) -> None:
    weights = tmp_path / "weights.pt"
    weights.write_bytes(b"1")
    completer = program(ONCE, *FILES, files=(str(weights),))()
    before = completer.weights_digest()
    assert before == completer.weights_digest() and len(before) == 64
    assert before == program(ONCE, *FILES, files=str(weights))().weights_digest()
    weights.write_bytes(b"2")
    assert completer.weights_digest() != before
    weights.unlink()
    with pytest.raises(PcdbenchError, match=r"weights.pt, of Mine, cannot be read .*check its `files`"):
        completer.weights_digest()
    assert program(ONCE, *FILES)().weights_digest() is None


PLUGIN = """
import sys
from pcdbench import Completer, CommandCompleter, FolderCompleter, PointCloud, hookimpl

class Here(Completer):
    def complete(self, cloud, rng):
        more = cloud.select(slice(9))
        return PointCloud.concatenate([cloud, PointCloud(more.points + 0.01, more.colors)])

class Elsewhere(FolderCompleter):
    pass

class Program(CommandCompleter):
    command = (sys.executable, {program!r}, "{{incomplete}}", "{{completed}}")
    suffix = ".npz"

class Stays(CommandCompleter):
    command = (sys.executable, {program!r})
    suffix = ".xyz"

@hookimpl
def register_completers(register):
    register("here", "mine:Here", "")
    register("elsewhere", "mine:Elsewhere", "")
    register("program", "mine:Program", "")
    register("stays", "mine:Stays", "")
"""
NUMPY_METHOD = """
import sys
import numpy as np
cloud = np.load(sys.argv[1])
if len(cloud["points"]) < {fewest}:
    print("too few for me")
    sys.exit(3)
steps = {{"points": 0.01, "colors": 0}}
both = {{name: np.concatenate([cloud[name], cloud[name][:9] + steps[name]]) for name in steps if name in cloud}}
np.savez(sys.argv[2], **both)
"""


@pytest.fixture
def mine(tmp_path: Path, tiny_plugins: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder to work in, with one method installed three times: here, as a program, and as clouds made elsewhere."""
    folder = tmp_path / "site"
    (folder / "mine-1.0.dist-info").mkdir(parents=True)
    (folder / "mine-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (folder / "mine-1.0.dist-info" / "entry_points.txt").write_text("[pcdbench]\nmine = mine\n")
    (folder / "mine.py").write_text(PLUGIN.format(program=str(tmp_path / "method.py")))
    (tmp_path / "method.py").write_text(NUMPY_METHOD.format(fewest=0))
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    registry.cache_clear()
    yield tmp_path
    registry.cache_clear()
    sys.modules.pop("mine", None)


def command(*arguments: str, code: int = 0) -> Any:
    ended = CliRunner().invoke(app, arguments)
    assert ended.exit_code == code, (ended.stdout, ended.stderr, ended.exception)
    return ended


SLABS = ("--dataset", "tiny", "--incompleteness", "slab", "--level")
CASES = (*SLABS, "0.3,0.5")


def run(name: str, *options: str, level: str = "0.3,0.5", code: int = 0) -> list[dict[str, Any]]:
    """The rows of a run of completers, without those of references."""
    out = f"runs/{name}-{time.monotonic_ns()}"
    asked = ("--completer", name, "--task", "tiny_gap", *SLABS, level)
    command("run", *asked, "--jobs", "1", "--out", out, *options, code=code)
    rows = [json.loads(line) for line in Path(out, "rows.jsonl").read_text().splitlines()]
    return [row for row in rows if row["completer"]["name"] in name.split(",")]


def measured(rows: list[dict[str, Any]]) -> dict[Any, float]:
    """What was measured of each case."""
    return {(row["scene"], row["level"]): row["metrics"]["gap_m"]["samples"][0] for row in rows}


def test_the_same_method_elsewhere_is_measured_the_same(mine: Path) -> None:
    command("data", "export", *CASES, "--out", "inc", "--format", "npz")
    (mine / "done").mkdir()
    for path in (mine / "inc").iterdir():
        inc = PointCloud.read(path)
        more = inc.select(np.arange(9))
        more = PointCloud(more.points + 0.01, more.colors)
        PointCloud.concatenate([inc, more]).write(mine / "done" / f"out_{path.stem}_final.ply")
    here = run("here")
    assert len(here) > 2 and {row["status"] for row in here} == {"ok"}
    # To what files keep of coordinates.
    same = pytest.approx(measured(here), rel=1e-4)
    assert measured(run("program")) == same
    elsewhere = run("elsewhere", "--option", "elsewhere.folder=done")
    assert measured(elsewhere) == same
    assert {row["completing"]["seconds"] for row in elsewhere} == {None}
    assert {row["completing"]["peak_memory_mb"] for row in elsewhere} == {None}
    shown = command("leaderboard", "build", *map(str, sorted(mine.glob("runs/*"))), "-o", "board")
    assert "without clouds" not in shown.stderr
    lines = [
        line for line in (mine / "board" / "README.md").read_text().splitlines() if line.startswith("| elsewhere |")
    ]
    assert lines and all(line.endswith("|  |  |  |") for line in lines)
    board = read_board(mine / "board")
    assert board.completed_elsewhere == {"elsewhere"}
    assert "elsewhere was completed elsewhere" in (mine / "board" / "README.md").read_text()
    assert [its["name"] for its in page_payload(board)["completers"] if its["flags"]] == ["elsewhere"]


def test_a_program_costs_its_seconds(mine: Path) -> None:
    rows = run("program")
    assert all(row["completing"]["seconds"] > 0.01 and row["completing"]["peak_memory_mb"] is None for row in rows)


def test_what_a_program_prints_is_with_its_failed_row(mine: Path) -> None:
    (mine / "method.py").write_text(NUMPY_METHOD.format(fewest=10**6))
    rows = run("program", code=3)
    assert {row["status"] for row in rows} == {"failed"}
    assert all("ended with exit code 3: too few for me" in row["error"] for row in rows)


@pytest.fixture
def temporary(mine: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where temporary files go."""
    folder = mine / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setenv("TMPDIR", str(folder))
    return folder


def test_of_a_program_that_hangs_all_that_it_printed_is_kept_and_no_file(mine: Path, temporary: Path) -> None:
    prompts = "import sys, time; sys.stderr.write('password: '); sys.stderr.flush(); time.sleep(60)"
    (mine / "method.py").write_text(prompts)
    rows = run("program,stays", "--option", "tiny.scenes=1", "--timeout", "3", "--jobs", "2", level="0.3", code=3)
    assert [(row["status"], row["output"].startswith("password: ")) for row in rows] == [("timeout", True)] * 2
    assert not list(temporary.iterdir())


def test_a_program_that_stays_leaves_no_file(mine: Path, temporary: Path, half_room: Case) -> None:
    (mine / "method.py").write_text(STAYS)
    (row,) = run("stays", "--option", "tiny.scenes=1", level="0.3")
    assert row["status"] == "ok" and not list(temporary.iterdir())
    pcdbench.complete(half_room.cloud, "stays", jobs=2)
    assert not list(temporary.iterdir())


def test_temporary_folders_of_workers_go_when_their_run_is_killed(tmp_path: Path) -> None:
    place = tmp_path / "place"
    (tmp_path / "script.py").write_text(
        """
import multiprocessing, sys, time
from pcdbench.workers import begin_worker, temporary_folder

def work():
    begin_worker(1, temporary=sys.argv[1])
    with temporary_folder() as folder:
        print(folder, flush=True)
        time.sleep(60)

if __name__ == "__main__":
    multiprocessing.get_context("spawn").Process(target=work).start()
    time.sleep(60)
"""
    )
    command = [sys.executable, str(tmp_path / "script.py"), str(place)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert Path(process.stderr.readline().strip()).parent == place and place.is_dir()
        process.kill()
    deadline = time.monotonic() + 10
    while place.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not place.exists()


def test_a_cloud_that_is_missing_fails_alone(mine: Path) -> None:
    command("data", "export", *CASES, "--out", "inc")
    first, *_ = sorted((mine / "inc").iterdir())
    tag = cloud_tag(PointCloud.read(first)) if first.suffix == ".npz" else first.stem[-16:]
    first.rename(mine / "aside.ply")
    rows = run("elsewhere", "--option", "elsewhere.folder=inc", code=3)
    (failed,) = [row for row in rows if row["status"] != "ok"]
    assert f"inc has no file with {tag} in its name" in failed["error"]
    (mine / "aside.ply").rename(first)
    assert {row["status"] for row in run("elsewhere", "--option", "elsewhere.folder=inc")} == {"ok"}


def test_other_clouds_in_the_folder_are_measured_anew(mine: Path) -> None:
    command("data", "export", *CASES, "--out", "inc")
    first = run("elsewhere", "--option", "elsewhere.folder=inc")
    changed = next((mine / "inc").iterdir())
    inc = PointCloud.read(changed)
    inc.select(np.arange(len(inc) // 2)).write(changed)
    assert measured(run("elsewhere", "--option", "elsewhere.folder=inc")) != measured(first)


def test_an_export_is_as_large_as_its_run_and_written_once(mine: Path) -> None:
    assert "6 incomplete clouds, 6 of them new" in command("data", "export", *CASES, "--out", "inc").stdout
    names = sorted(path.name for path in (mine / "inc").iterdir())
    assert all(name.endswith(".ply") for name in names) and sum("-slab-0.3-" in name for name in names) == 3
    times = [path.stat().st_mtime_ns for path in sorted((mine / "inc").iterdir())]
    assert "6 incomplete clouds, 0 of them new" in command("data", "export", *CASES, "--out", "inc").stdout
    assert times == [path.stat().st_mtime_ns for path in sorted((mine / "inc").iterdir())]
    command("data", "export", *CASES, "--seed", "1", "--out", "inc")
    assert len(list((mine / "inc").iterdir())) == 12


def test_an_export_takes_the_suite_whose_completer_has_no_clouds_yet(mine: Path) -> None:
    (mine / "suite.toml").write_text(
        'dataset = "tiny"\nincompletenesses = ["slab"]\nlevels = [0.3, 0.5]\ntasks = ["tiny_gap"]\nseeds = [0, 1]\n'
        'completers = [{name = "elsewhere", options = {folder = "done"}}]\n'
    )
    assert "12 incomplete clouds" in command("data", "export", "suite.toml", "--out", "done").stdout
    command("run", "suite.toml", "--out", "runs/suite", "--jobs", "1")
    command("data", "export", "suite.toml", "--seed", "1", code=2)


def test_a_case_that_cannot_be_made_is_told_and_the_others_are_written(mine: Path) -> None:
    (mine / "scans").mkdir()
    rng = np.random.default_rng(0)
    PointCloud(rng.random((2000, 3))).write(mine / "scans" / "good.ply")
    (mine / "scans" / "cut.ply").write_bytes((mine / "scans" / "good.ply").read_bytes()[:-100])
    ended = command("data", "export", "--dataset", "clouds:scans", "--level", "0.3", "--out", "inc", code=3)
    assert "pcdbench: cut at level 0.3: " in ended.stderr and "1 incomplete clouds, 1 of them new" in ended.stdout
    (path,) = (mine / "inc").iterdir()
    assert path.name.startswith("good-holes-0.3-") and len(PointCloud.read(path)) == 1400


def test_hidden_files_are_no_completed_clouds(tmp_path: Path, half_room: Case) -> None:
    # What another program is at, and what a system notes of a file.
    for name in ("cloud-", ".unfinished-", "._cloud-"):
        half_room.cloud.write(tmp_path / f"{name}{cloud_tag(half_room.cloud)}.ply")
    os.mkfifo(tmp_path / f"pipe-{cloud_tag(half_room.cloud)}.ply")
    completer = FolderCompleter(FolderCompleter.Options(folder=str(tmp_path)))
    assert len(complete(completer, half_room.cloud)) == len(half_room.cloud)


WRONG_FOLDERS = {
    "none named": ("", "FolderCompleter needs the folder"),
    "not there": ("nowhere", "are not at nowhere .*No such file"),
    "empty": ("empty", "no cloud in empty is named as pcdbench data export"),
    "twice": ("twice", "are of the same incomplete cloud; keep one"),
}


@pytest.mark.parametrize(("folder", "message"), WRONG_FOLDERS.values(), ids=WRONG_FOLDERS)
def test_a_folder_that_cannot_be_used_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, half_room: Case, folder: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "notes-0123456789abcdef.md").write_text("")
    for name in "ab":
        half_room.cloud.write(tmp_path / "twice" / f"{name}-{cloud_tag(half_room.cloud)}.ply")
    with pytest.raises(PcdbenchError, match=message) as raised:
        FolderCompleter(FolderCompleter.Options(folder=folder))
    assert len(str(raised.value).splitlines()) == 1
