"""Whatever is typed: one line on standard error and a stated exit code, never a traceback."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from pcdbench.cli import app

ODD = (
    "", " ", "-", "--", "0", "-1", "1e999", "nan", "0.3,", ",", "all", "None", "../../x", "/dev/null", "/", "a\nb", "é",
    "x" * 5000, "[red]", "%s", "{}", "clouds:", "clouds:/nonexistent", "nosuch", "chamfer.", "chamfer.x=1", "9" * 500,
)  # fmt: skip
VALUES = st.one_of(st.sampled_from(ODD), st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0")))
# The data set of these runs has one scene of one point: nothing can begin to compute.
RUN = ("--split", "--incompleteness", "--level", "--seed", "--jobs", "--option", "--format")
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


@fuzzed(40)
@given(st.sampled_from(["show", "results", "view", "list", "data", "audit", "nosuch"]), st.lists(VALUES, max_size=2))
def test_words(command: str, words: list[str]) -> None:
    # An audit of a real task would compute for minutes.
    check([command, *(f"no{word}" if command == "audit" else word for word in words)])


@fuzzed(40)
@given(st.lists(st.tuples(st.sampled_from(RUN), VALUES), max_size=3))
def test_options_of_a_run(one_point: Path, options: list[tuple[str, str]]) -> None:
    given_ = [part for name, value in options for part in (f"{name}={value}",)]
    out = one_point.parent / "run"
    base = ["run", "--completer", "plane_fitting", "--task", "chamfer", f"--dataset=clouds:{one_point}", f"--out={out}"]
    check([*base, *given_])


@fuzzed(40)
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
