"""`pcdbench list` and `pcdbench show`: quick, complete, and one line for what is wrong."""

import resource
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from typing import Annotated, Literal

import pytest
from pydantic import Field, PositiveInt
from typer.testing import CliRunner, Result

from pcdbench import Completer, Dataset, Metric, Options, PcdbenchError, PointCloud, Task, __version__, plugins
from pcdbench.cli import app, list_, show
from pcdbench.plugins import GROUP, Register, hookimpl

HERE = __name__


class Smear(Completer):
    """Smears points about.

    A second paragraph.
    """

    class Options(Options):
        distance_m: float = Field(0.02, gt=0, le=1, description="how far, metres")
        axes: tuple[int, ...] = Field((0, 1), description="which axes")
        reaches_m: tuple[Annotated[float, Field(gt=0, le=9)], PositiveInt] = Field((1.5, 2), description="two reaches")
        how: Literal["evenly", "oddly"] = Field("evenly", description="the manner")

    version = "7"
    needs_color = True
    citation = "Nobody et al. 2026"

    def complete(self, cloud: PointCloud, rng: object) -> PointCloud:
        return cloud


class Strict(Completer):
    """Has an option that must be given."""

    class Options(Options):
        reach_m: float

    def complete(self, cloud: PointCloud, rng: object) -> PointCloud:
        return cloud


class Learned(Strict):
    """Has an option that is empty unless given."""

    class Options(Options):
        weights: str = ""


class Weigh(Task):
    """Weighs."""

    metrics = (
        Metric("mass_kg", "kg", "lower", "volume times density"),
        Metric("share", "share", "higher", "mass over all mass", summary="mean"),
    )

    def evaluate(self, case: object, completed: object, rng: object) -> None:  # type: ignore[override]
        raise NotImplementedError


class Places(Dataset):
    """Places."""

    default_split = "b"

    def splits(self) -> list[str]:
        return ["a", "b"]

    def scene_names(self, split: str) -> list[str]:
        return []

    def scene(self, name: str) -> None:  # type: ignore[override]
        raise NotImplementedError

    def digest(self, name: str) -> str:
        return ""


class NeedsPath(Places):
    """Places in a folder."""

    def splits(self) -> list[str]:
        raise PcdbenchError("name a folder: needs_path:FOLDER")


class Hooks:
    @hookimpl
    def register_completers(self, register: Register) -> None:
        register("smear", f"{HERE}:Smear", "smears", reference=True)
        register("same", f"{HERE}:Smear", "as a completer")
        register("strict", f"{HERE}:Strict", "must be told how far")
        register("learned", f"{HERE}:Learned", "has weights")

    @hookimpl
    def register_tasks(self, register: Register) -> None:
        register("weigh", f"{HERE}:Weigh", "weighs")
        register("same", f"{HERE}:Weigh", "as a task")
        register("gone", "no_such_module:Class", "its module is not there")
        register("no_task", f"{HERE}:Smear", "a completer")

    @hookimpl
    def register_datasets(self, register: Register) -> None:
        register("places", f"{HERE}:Places", "places")
        register("needs_path", f"{HERE}:NeedsPath", "places in a folder")


class OtherHooks:
    @hookimpl
    def register_tasks(self, register: Register) -> None:
        register("twice", "a:A", "one")


class ClashingHooks(OtherHooks):
    pass


HOOKS, OTHER, CLASHING = Hooks(), OtherHooks(), ClashingHooks()


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Good plugins, one that is broken, two that clash."""
    found = [
        EntryPoint("good", f"{HERE}:HOOKS", GROUP),
        EntryPoint("other", f"{HERE}:OTHER", GROUP),
        EntryPoint("clashing", f"{HERE}:CLASHING", GROUP),
        EntryPoint("bad", "no_such_module", GROUP),
    ]
    registry = plugins.load_registry(found)
    monkeypatch.setattr(list_, "registry", lambda: registry)
    monkeypatch.setattr(show, "registry", lambda: registry)
    yield


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


@pytest.mark.usefixtures("installed")
def test_list_names_everything_and_what_is_broken() -> None:
    result = run("list")
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert lines.index("completers") < lines.index("tasks") < lines.index("data sets") < lines.index("incompletenesses")
    smear = next(line for line in lines if line.startswith("  smear "))
    assert "smears [reference]" in smear and "good = " in smear
    assert lines[lines.index("incompletenesses") + 1] == "  none"
    assert any(line.startswith("not loaded: ? (bad = no_such_module): ModuleNotFoundError") for line in lines)
    (clash,) = (line for line in lines if line.startswith("clash: task 'twice'"))
    assert "OTHER" in clash and "CLASHING" in clash


@pytest.mark.usefixtures("installed")
def test_show_a_completer() -> None:
    result = run("show", "smear")
    assert result.exit_code == 0, result.output
    for text in (
        "smear: completer, a reference",
        f"class      {HERE}:Smear",
        "version    7",
        "needs      points and their colours",
        "cite       Nobody et al. 2026",
        "  A second paragraph.",
        "distance_m  float > 0 and <= 1, default 0.02",
        "how far, metres",
        "axes  tuple[int, ...], default 0,1",
        "reaches_m  tuple[float > 0 and <= 9, int > 0], default 1.5,2",
        "how  Literal['evenly', 'oddly'], default evenly",
        "for example: --option smear.distance_m=0.02",
    ):
        assert text in result.output, text


@pytest.mark.usefixtures("installed")
def test_an_option_without_default_is_shown_as_required() -> None:
    output = run("show", "strict").output
    assert "reach_m  float, required" in output and "for example: --option strict.reach_m=VALUE" in output


@pytest.mark.usefixtures("installed")
def test_an_option_that_is_empty_unless_given_is_shown_so() -> None:
    output = run("show", "learned").output
    assert "weights  str, default empty" in output and "for example: --option learned.weights=VALUE" in output


@pytest.mark.usefixtures("installed")
def test_show_a_task_with_its_metrics() -> None:
    output = run("show", "weigh").output
    assert "mass_kg  [kg], lower is better, summed up by its median" in output
    assert "share  [share], higher is better, summed up by its mean" in output
    assert "volume times density" in output and "options: none" in output


@pytest.mark.usefixtures("installed")
def test_show_a_data_set_with_its_splits() -> None:
    assert "splits     a, b (default)" in run("show", "places").output
    assert "splits     default b; name a folder: needs_path:FOLDER" in run("show", "needs_path").output


@pytest.mark.usefixtures("installed")
def test_a_name_of_two_kinds_shows_both() -> None:
    output = run("show", "same").output
    assert "same: completer" in output and "same: task" in output


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("weihg", "pcdbench: nothing is called 'weihg'; did you mean weigh?"),
        ("gone", "pcdbench: task 'gone' from ? (good = "),
        ("twice", "pcdbench: task 'twice' is registered by"),
        ("no_task", "pcdbench: task 'no_task': "),
    ],
)
def test_what_cannot_be_shown_is_one_line_and_exit_2(name: str, says: str) -> None:
    result = run("show", name)
    assert result.exit_code == 2
    assert result.stdout == "" and result.stderr.startswith(says) and result.stderr.count("\n") == 1


@pytest.mark.parametrize("name", [one.name for kind in plugins.KINDS for one in plugins.registry().all(kind)])
def test_everything_of_ours_can_be_shown(name: str) -> None:
    result = run("show", name)
    assert result.exit_code == 0, result.output
    assert result.output.startswith(f"{name}: ")


def test_ctrl_c_is_one_line_and_exit_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(list_, "registry", interrupted)
    result = run("list")
    assert (result.exit_code, result.stderr) == (130, "pcdbench: stopped\n")


def test_version_and_wrong_use() -> None:
    assert run("--version").output == f"pcdbench {__version__}\n"
    wrong = run("no-such-command")
    assert wrong.exit_code == 2 and "no-such-command" in wrong.output


@pytest.mark.parametrize("command", ["--help", "list"])
def test_answers_in_half_a_second_without_the_heavy_libraries(command: str) -> None:
    program = (
        "import sys; from pcdbench.cli import main; sys.argv = ['pcdbench', sys.argv[1]]\n"
        "try: main()\n"
        "except SystemExit as end: code = end.code\n"
        "heavy = {'numpy', 'scipy', 'pandas', 'matplotlib', 'torch', 'open3d'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else code)"
    )
    # Processor time, so that a busy machine does not decide the test; free, it is what a user waits.
    seconds = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([sys.executable, "-c", program, command], capture_output=True, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        assert done.returncode == 0, done.stderr
    assert min(seconds) < 0.5
