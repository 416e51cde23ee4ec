"""Plugins: found by entry point, loaded one at a time and lazily, and reported by name where they fail."""

import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from pcdbench import Metric, Options, Task
from pcdbench.completer import Completer, ReferenceCompleter
from pcdbench.errors import PluginError
from pcdbench.plugins import GROUP, KINDS, Register, Registry, did_you_mean, hookimpl, load_registry

Hook = Callable[[Register], None]


@pytest.fixture
def entry_point(monkeypatch: pytest.MonkeyPatch) -> Callable[..., EntryPoint]:
    """Makes a module with the given hooks importable, and an entry point of its name."""

    def make(name: str, **hooks: Hook) -> EntryPoint:
        module = ModuleType(f"plugin_{name}")
        for hook, function in hooks.items():
            setattr(module, hook, hookimpl(function))
        monkeypatch.setitem(sys.modules, module.__name__, module)
        return EntryPoint(name, module.__name__, GROUP)

    return make


def registering(name: str, target: str = "nowhere.at.all:Class") -> Hook:
    def hook(register: Register) -> None:
        register(name, target, f"summary of {name}")

    return hook


def test_our_own_plugins_are_found_by_their_entry_points() -> None:
    found = load_registry(entry_points(group=GROUP))
    assert found.broken == {}
    names = {kind: {one.name for one in found.all(kind)} for kind in KINDS}
    assert {"incomplete", "ground_truth", "resample", "plane_fitting", "hole_filling"} <= names["completer"]
    assert {"chamfer", "ssim", "localization", "tracking", "tagging"} <= names["task"]
    assert {"indoor", "clouds"} <= names["dataset"]
    assert {"holes", "short_scan"} <= names["incompleteness"]
    references = {one.name for one in found.all("completer") if one.reference}
    assert references == {"incomplete", "ground_truth", "resample"}


def test_each_hook_registers_its_own_kind(entry_point: Callable[..., EntryPoint]) -> None:
    point = entry_point(
        "four",
        register_completers=registering("a"),
        register_tasks=registering("b"),
        register_datasets=registering("c"),
        register_incompletenesses=registering("d"),
    )
    found = load_registry([point])
    assert [[one.name for one in found.all(kind)] for kind in KINDS] == [["a"], ["b"], ["c"], ["d"]]
    only = found.get("task", "b")
    assert (only.summary, only.target, only.origin) == (
        "summary of b",
        "nowhere.at.all:Class",
        "? (four = plugin_four)",
    )


def test_a_module_whose_hooks_are_not_marked_is_broken(entry_point: Callable[..., EntryPoint]) -> None:
    point = entry_point("unmarked")
    vars(sys.modules["plugin_unmarked"])["register_tasks"] = registering("b")
    told = load_registry([point]).broken["? (unmarked = plugin_unmarked)"]
    assert "has none of the hooks" in told and "mark them with @pcdbench.hookimpl" in told


def test_registering_imports_nothing_and_loading_says_why_it_failed(entry_point: Callable[..., EntryPoint]) -> None:
    found = load_registry([entry_point("lazy", register_tasks=registering("later"))])
    with pytest.raises(PluginError, match=r"task 'later' from .*lazy.* nowhere.at.all:Class: ModuleNotFoundError"):
        found.get("task", "later").load()


def test_loading_a_class_that_its_module_lacks_is_one_line(entry_point: Callable[..., EntryPoint]) -> None:
    found = load_registry([entry_point("lazy", register_tasks=registering("later", "json:NoSuchThing"))])
    with pytest.raises(PluginError, match="NoSuchThing"):
        found.get("task", "later").load()


class IntegerVersion(Completer):
    version = 2  # type: ignore[assignment]

    def complete(self, cloud: object, rng: object) -> None:  # type: ignore[override]
        raise NotImplementedError


class SeesTheTruth(ReferenceCompleter):
    def answer(self, case: object, rng: object) -> None:  # type: ignore[override]
        raise NotImplementedError


class NoOptions(Completer):
    Options: Any = Options()

    def complete(self, cloud: object, rng: object) -> None:  # type: ignore[override]
        raise NotImplementedError


class MetricsByName(Task):
    metrics: Any = ("error_m",)

    def evaluate(self, case: object, completed: object, rng: object) -> None:  # type: ignore[override]
        raise NotImplementedError


@pytest.mark.parametrize(
    ("target", "says"),
    [
        ("collections:OrderedDict", "is not a subclass of pcdbench.Completer"),
        ("json:dumps", "is not a subclass of pcdbench.Completer"),
        (f"{__name__}:IntegerVersion", 'has the version 2; it must be a text such as "1"'),
        (f"{__name__}:SeesTheTruth", "sees the complete cloud; register it with reference=True (it is not ranked)"),
        (f"{__name__}:NoOptions", ": its Options must be a subclass of pcdbench.Options"),
    ],
)
def test_a_class_that_is_no_completer_is_refused(
    entry_point: Callable[..., EntryPoint], target: str, says: str
) -> None:
    found = load_registry([entry_point("odd", register_completers=registering("odd_one", target))])
    with pytest.raises(PluginError, match="completer 'odd_one': ") as caught:
        found.get("completer", "odd_one").load()
    assert str(caught.value).endswith(says) and target in str(caught.value)


def test_metrics_that_are_none_are_refused(entry_point: Callable[..., EntryPoint]) -> None:
    found = load_registry([entry_point("odd", register_tasks=registering("odd_one", f"{__name__}:MetricsByName"))])
    with pytest.raises(PluginError, match=r"its metrics must be a tuple of pcdbench.Metric, not \('error_m',\)"):
        found.get("task", "odd_one").load()


@pytest.mark.parametrize(
    ("metrics", "says"),
    [
        ([("gap_m", "m", "lower", "f", "p90")], "the summary of gap_m is 'p90'; median or mean"),
        ([("gap_m", "m", "less", "f")], "the direction of gap_m is 'less'; lower or higher"),
        ([("gap_m", None, "lower", "f")], "the unit of metric 'gap_m' is no text: None"),
        ([(3, "m", "lower", "f")], "the name of metric 3 is no text: 3"),
        ([("gap_m", "m", "lower", "f"), ("gap_m", "m", "higher", "f")], "names a metric twice: gap_m, gap_m"),
    ],
)
def test_metrics_whose_rows_nobody_could_read_again_are_refused(
    entry_point: Callable[..., EntryPoint], monkeypatch: pytest.MonkeyPatch, metrics: list[Any], says: str
) -> None:
    monkeypatch.setattr(MetricsByName, "metrics", tuple(Metric(*its) for its in metrics))
    found = load_registry([entry_point("odd", register_tasks=registering("odd_one", f"{__name__}:MetricsByName"))])
    with pytest.raises(PluginError, match="task 'odd_one': ") as caught:
        found.get("task", "odd_one").load()
    assert str(caught.value).endswith(says)


@pytest.mark.parametrize("weights", [["no/w.safetensors"], [Path("no/w.safetensors")], "no/w.safetensors"])
def test_weights_may_be_named_as_text(entry_point: Callable[..., EntryPoint], weights: Any) -> None:
    def hook(register: Register) -> None:
        register("learned", "x:Y", "learns", weights=weights)

    (only,) = load_registry([entry_point("one", register_completers=hook)]).all("completer")
    assert only.weights == (Path("no/w.safetensors"),) and only.lacks_weights


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"weights": [3]}, "completer 'odd_one': weights [3] must be a list of paths"),
        ({"weights": None}, "completer 'odd_one': weights None must be a list of paths"),
        ({"summary": None}, "completer 'odd_one': summary None must be a text of one line"),
    ],
)
def test_what_cannot_be_listed_costs_its_own_plugin(
    entry_point: Callable[..., EntryPoint], given: dict[str, Any], says: str
) -> None:
    def hook(register: Register) -> None:
        register(**({"name": "odd_one", "target": "x:Y", "summary": "odd"} | given))

    found = load_registry(
        [entry_point("odd", register_completers=hook), entry_point("fine", register_completers=registering("good"))]
    )
    assert [one.name for one in found.all("completer")] == ["good"]
    assert list(found.broken.values()) == [f"PluginError: {says}"]


def test_a_broken_plugin_costs_nothing_but_itself(entry_point: Callable[..., EntryPoint]) -> None:
    def explode(register: Register) -> None:
        register("half_done", "x:Y", "registered before the error")
        raise ValueError("the plugin's own bug")

    def leave(register: Register) -> None:
        sys.exit("usage: leaving FILE")

    found = load_registry(
        [
            entry_point("leaving", register_completers=leave),
            EntryPoint("missing", "no_such_module_anywhere", GROUP),
            entry_point("exploding", register_tasks=explode),
            entry_point("fine", register_tasks=registering("good")),
        ]
    )
    assert [one.name for one in found.all("task")] == ["good"]
    errors = {origin.split()[1]: error for origin, error in found.broken.items()}
    assert errors["(missing"].startswith("ModuleNotFoundError")
    assert errors["(exploding"] == "ValueError: the plugin's own bug"
    assert errors["(leaving"] == "SystemExit: usage: leaving FILE"
    with pytest.raises(PluginError, match=r"not loaded: .*exploding.*missing.*pcdbench list"):
        found.get("task", "half_done")


def test_a_plugin_that_leaves_at_its_import_costs_nothing_but_itself(
    entry_point: Callable[..., EntryPoint], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "leaving.py").write_text("import sys\nsys.exit('install its library first')\n")
    monkeypatch.syspath_prepend(tmp_path)
    found = load_registry(
        [
            EntryPoint("leaves", "leaving", GROUP),
            entry_point("fine", register_tasks=registering("good", "leaving:Task")),
        ]
    )
    assert list(found.broken.values()) == ["SystemExit: install its library first"]
    with pytest.raises(PluginError, match=r"'good' .* cannot be loaded .*: SystemExit: install its library first"):
        found.get("task", "good").load()


def test_a_misspelt_hook_is_reported_not_ignored(entry_point: Callable[..., EntryPoint]) -> None:
    found = load_registry([entry_point("typo", register_taks=registering("lost"))])
    (error,) = found.broken.values()
    assert "register_taks" in error


@pytest.mark.parametrize("name", ["Upper", "with space", "dash-ed", "", "dot.ted", "ümlaut"])
def test_bad_names_are_refused(entry_point: Callable[..., EntryPoint], name: str) -> None:
    found = load_registry([entry_point("bad", register_tasks=registering(name))])
    (error,) = found.broken.values()
    assert repr(name) in error and "lower case" in error


def test_a_target_must_name_module_and_class(entry_point: Callable[..., EntryPoint]) -> None:
    found = load_registry([entry_point("bad", register_tasks=registering("fine_name", "package.module"))])
    (error,) = found.broken.values()
    assert "package.module:Class" in error


def test_two_plugins_of_one_name_are_an_error_that_names_both(entry_point: Callable[..., EntryPoint]) -> None:
    found = load_registry(
        [
            entry_point("one", register_tasks=registering("same")),
            entry_point("two", register_tasks=registering("same"), register_datasets=registering("same")),
        ]
    )
    assert found.all("task") == []
    assert [one.name for one in found.all("dataset")] == ["same"]
    (clash,) = found.clashes()
    assert "plugin_one" in clash and "plugin_two" in clash and "task 'same'" in clash
    for look_up in (lambda: found.get("task", "same"), lambda: found.find("same")):
        with pytest.raises(PluginError, match=r"plugin_one.* and .*plugin_two"):
            look_up()


def test_the_order_of_entry_points_does_not_matter(entry_point: Callable[..., EntryPoint]) -> None:
    points = [entry_point(name, register_tasks=registering(f"task_{name}")) for name in ("b", "a", "c")]
    assert load_registry(points) == load_registry(points[::-1])


def test_find_looks_in_every_kind(entry_point: Callable[..., EntryPoint]) -> None:
    found = load_registry(
        [entry_point("p", register_tasks=registering("twice"), register_completers=registering("twice"))]
    )
    assert [one.kind for one in found.find("twice")] == ["completer", "task"]
    with pytest.raises(PluginError, match=r"nothing is called 'twize'; did you mean twice\?"):
        found.find("twize")


def test_unknown_names_get_a_suggestion_or_the_choice() -> None:
    assert did_you_mean("plane_fiting", ["plane_fitting", "chamfer"]) == "did you mean plane_fitting?"
    assert did_you_mean("zzz", ["plane_fitting", "chamfer"]) == "there is plane_fitting, chamfer"
    with pytest.raises(PluginError, match="nothing of that kind"):
        Registry().get("task", "any")


def test_modules_are_there_after_importing_the_package_alone():
    """In a process of its own: here they are imported already."""
    program = (
        "import pcdbench, sys; assert 'pcdbench.weights' not in sys.modules\n"
        "print(pcdbench.weights.LearnedCompleter.__name__, hasattr(pcdbench, 'wieghts'))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.split() == ["LearnedCompleter", "False"], done.stderr
