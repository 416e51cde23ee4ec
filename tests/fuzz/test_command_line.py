"""Whatever is typed: one line on standard error and a stated exit code, never a traceback."""

from pathlib import Path

import numpy as np
import pytest
from fuzz_mutations import mutated_toml
from fuzz_seeds import SEEDS
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from pcdbench.cli import app
from pcdbench.errors import PcdbenchError

ODD = (
    "", " ", "-", "--", "0", "-1", "1e999", "nan", "0.3,", ",", "all", "None", "../../x", "/dev/null", "/", "a\nb", "é",
    "x" * 5000, "[red]", "%s", "{}", "clouds:", "clouds:/nonexistent", "nosuch", "chamfer.", "chamfer.x=1", "9" * 500,
)  # fmt: skip
VALUES = st.one_of(st.sampled_from(ODD), st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0")))
# The data set of these runs has one scene of one point: nothing can begin to compute.
RUN = ("--split", "--incompleteness", "--level", "--seed", "--jobs", "--option", "--format")
TRAIN = ("--hours", "--steps", "--preset", "--device", "--option", "--seed", "--workers")
COMPLETE = ("--option", "--up", "--tile-m", "--runs", "--seed", "--completer")


@pytest.fixture(scope="module")
def one_point(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scan") / "one_point.xyz"
    path.write_text("1 2 3\n")
    return path


def check(arguments: list[str]) -> None:
    result = CliRunner().invoke(app, arguments)
    assert result.exception is None or isinstance(result.exception, SystemExit), (arguments, result.exception)
    assert result.exit_code in (0, 1, 2), arguments
    assert "Traceback" not in result.output


def fuzzed(examples: int) -> settings:
    return settings(
        max_examples=examples,
        derandomize=True,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )


@fuzzed(20)
@given(st.sampled_from(["show", "results", "view", "list", "data", "audit", "nosuch"]), st.lists(VALUES, max_size=2))
def test_words(command: str, words: list[str]) -> None:
    # An audit of a real task would compute for minutes.
    check([command, *(f"no{word}" if command == "audit" else word for word in words)])


@fuzzed(20)
@given(st.lists(st.tuples(st.sampled_from(RUN), VALUES), max_size=3))
def test_options_of_a_run(one_point: Path, options: list[tuple[str, str]]) -> None:
    given_ = [part for name, value in options for part in (f"{name}={value}",)]
    out = one_point.parent / "run"
    base = ["run", "--completer", "plane_fitting", "--task", "chamfer", f"--dataset=clouds:{one_point}", f"--out={out}"]
    check([*base, *given_])


@fuzzed(20)
@given(st.lists(st.tuples(st.sampled_from(COMPLETE), VALUES), max_size=3))
def test_options_of_a_completion(one_point: Path, options: list[tuple[str, str]]) -> None:
    out = one_point.with_name("out.ply")
    check(["complete", str(one_point), f"--out={out}", "--completer=plane_fitting", *(f"{a}={b}" for a, b in options)])


def test_a_scan_that_is_too_small_is_named(one_point: Path) -> None:
    result = CliRunner().invoke(
        app, ["complete", str(one_point), "--out", str(one_point.with_name("out.ply")), "--completer", "plane_fitting"]
    )
    assert result.exit_code == 2
    assert f"{one_point}: the cloud has 1 points" in result.output


def some(options: tuple[str, ...], values: st.SearchStrategy[str] = VALUES) -> st.SearchStrategy[list[str]]:
    """Up to three of these options, each with one of these values."""
    return st.lists(st.builds("{}={}".format, st.sampled_from(options), values), max_size=3)


@fuzzed(20)
@given(st.integers(0, 2**32), some(("--seed", "--completer", "--dataset", "--jobs", "--format")))
def test_suites_and_options_beside_them(one_point: Path, number: int, options: list[str]) -> None:
    folder = one_point.parent / "suite"
    folder.mkdir(exist_ok=True)
    (suite,) = SEEDS["suite"](folder)
    suite.write_bytes(mutated_toml(suite.read_bytes(), np.random.default_rng(number)))
    # One run of a suite is a folder in --out; that is a file here, and no run begins.
    check(["run", str(suite), f"--dataset=clouds:{one_point}", f"--out={one_point}", *options])


@fuzzed(20)
@given(VALUES)
def test_suites_that_are_none(word: str) -> None:
    check(["run", f"./{word}"])


@pytest.fixture
def no_training(monkeypatch: pytest.MonkeyPatch, one_point: Path) -> Path:
    """A folder of its own in which `train` would begin, were it not refused there."""
    from pcdbench.training import loop, validation

    def begin(*_: object, **__: object) -> None:
        raise PcdbenchError("it would train now")

    monkeypatch.setattr(validation, "Validation", lambda: None)
    monkeypatch.setattr(loop, "Accelerator", begin)
    folder = one_point.parent / "a" / "b" / "c"
    folder.mkdir(parents=True, exist_ok=True)
    monkeypatch.chdir(folder)
    return folder


@fuzzed(15)
@given(st.one_of(st.sampled_from(["voxel_unet", "deeppcd.", ".", "chamfer"]), VALUES), VALUES, some(TRAIN))
def test_options_of_a_training(no_training: Path, name: str, out: str, options: list[str]) -> None:
    check(["train", f"--out={no_training}/{out}", "--steps=1", *options, "--", name])


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--out=new", "--steps=1"], "it would train now"),
        (["--out=new", "--hours=nan"], "--hours"),
        (["--out=new", "--hours=inf"], "must be a number of hours"),
        (["--out=new", "--steps=1", "--seed=-1"], "--seed"),
        (["--out=new", "--steps=1", "--seed=" + "9" * 500], "--seed"),
        (["--out=new", "--steps=1", "--workers=1000000000"], "--workers"),
        (["--out=new", "--steps=1", "--from=none"], "check the path"),
        (["--out=/dev/null/new", "--steps=1"], "cannot be made"),
    ],
)
def test_a_training_that_cannot_begin(no_training: Path, options: list[str], told: str) -> None:
    result = CliRunner().invoke(app, ["train", "voxel_unet", *options])
    assert result.exit_code == 2 and told in result.output


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A board's folder with a run beside it in which its completer `mine` is not installed."""
    folder = tmp_path_factory.mktemp("boards") / "a" / "b" / "board"
    folder.mkdir(parents=True)
    SEEDS["board"](folder)
    return folder


@fuzzed(15)
@given(st.lists(VALUES, max_size=2), VALUES, some(("--cases",)), st.booleans())
def test_building_a_board(board: Path, runs: list[str], out: str, options: list[str], sound: bool) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pcdbench.leaderboard.publishing.write_figures", lambda *_: {})
        patch.chdir(board)
        words = ["./run"] if sound else [f"./{run}" for run in runs]
        check(["leaderboard", "build", f"--out=new/{out}", *options, *words])


@fuzzed(20)
@given(VALUES, some(("--markdown", "--junit", "--out"), VALUES.map("new/{}".format)), some(("--jobs", "--dataset")))
def test_checking_a_board(board: Path, run: str, paths: list[str], options: list[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(board)
        for words in ([".", "--run=run"], [".", f"--run=./{run}"], [f"./{run}"], ["."]):
            check(["leaderboard", "check", *words, *paths, *options])


@fuzzed(20)
@given(st.one_of(VALUES, st.sampled_from(["0" * 6, "0" * 16, f"{1:064}"])), VALUES, some(("--dataset",)))
def test_a_case_of_a_board(board: Path, key: str, out: str, options: list[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(board)
        check(["leaderboard", "case", *options, "--", ".", key])
        check(["leaderboard", "case", f"--out=new/{out}.html", *options, "--", ".", key])
