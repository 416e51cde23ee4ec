"""`pcdbench check`: what holds of a plugin's contract, line by line, and what does not."""

import pytest
from typer.testing import CliRunner

from pcdbench.cli import app

pytestmark = pytest.mark.usefixtures("tiny_plugins")


def checked(*arguments: str, code: int) -> list[str]:
    ended = CliRunner().invoke(app, ["check", *arguments])
    assert ended.exit_code == code, (ended.output, ended.exception)
    return (ended.stderr if code == 2 else ended.stdout).splitlines()


def test_a_completer_that_keeps_its_contract() -> None:
    lines = checked("plane_fitting", code=0)
    assert len(lines) == 5 and all(line.startswith("holds: ") for line in lines)
    assert lines[-1] == "holds: map coordinates of 10^6 m keep their millimetres"


def test_a_reference_and_a_task_that_keep_theirs() -> None:
    assert len(checked("incomplete", code=0)) == 2
    lines = checked("chamfer", code=0)
    assert len(lines) == 4 and lines[-1].startswith("holds: chd is better for the truth (0)")


@pytest.mark.parametrize(
    ("how", "problem"),
    [
        ("raise", "does not hold: Faulty.complete(): ZeroDivisionError: no plane has been found"),
        ("exit", "does not hold: Faulty.complete(): SystemExit: good bye"),
        ("wrong", "does not hold: Faulty must return a PointCloud, not ndarray"),
    ],
)
def test_what_does_not_hold_is_the_last_line(how: str, problem: str) -> None:
    options = ("--option", f"tiny_faulty.how={how}", "--option", "tiny_faulty.level=-9")
    lines = checked("tiny_faulty", *options, code=1)
    assert lines[-1].startswith(problem)


def test_a_constructor_that_raises_is_one_line(monkeypatch) -> None:
    def unbuilt(*_: object) -> None:
        raise RuntimeError("no GPU")

    monkeypatch.setattr("pcdbench_completers.plane_fitting.PlaneFitting.__init__", unbuilt)
    assert checked("plane_fitting", code=1) == ["does not hold: plane_fitting(): RuntimeError: no GPU"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["holes"], "pcdbench: holes: no completer and no task has this name"),
        (["plane_fiting"], "pcdbench: nothing is called 'plane_fiting'; did you mean plane_fitting"),
        (["chamfer", "--option", "ssim.x=1"], "pcdbench: --option ssim"),
    ],
)
def test_what_cannot_be_checked_is_one_line_and_exit_2(arguments: list[str], message: str) -> None:
    (line,) = checked(*arguments, code=2)
    assert line.startswith(message)
