"""The contract checks: our own plugins pass them, and each way of breaking a contract is found and named."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydantic import Field

from pcdbench import Case, Completer, Measurements, Metric, Options, PointCloud, Skipped, Task
from pcdbench.geometry.neighbors import nearest
from pcdbench.plugins import registry
from pcdbench.scene import Scene
from pcdbench.testing import check_completer, check_task, small_room

OURS = {kind: [one for one in registry().all(kind) if "pcdbench" in one.target] for kind in ("completer", "task")}


@pytest.mark.parametrize("name", [one.name for one in OURS["completer"]])
def test_our_completers_keep_their_contract(name: str) -> None:
    registration = registry().get("completer", name)
    if not all(path.is_file() for path in registration.weights):
        pytest.skip(f"the package has no weights of {name}")
    check_completer(registration.load())


@pytest.mark.parametrize("name", [one.name for one in OURS["task"]])
def test_our_tasks_keep_their_contract(name: str) -> None:
    check_task(registry().get("task", name).load())


def completer(complete: Callable[[PointCloud, np.random.Generator], Any], **attributes: Any) -> type[Completer]:
    """A completer class that does `complete`."""
    return type("Faulty", (Completer,), {"complete": lambda self, cloud, rng: complete(cloud, rng), **attributes})


class NoDefault(Options):
    distance_m: float = Field(description="how far")


class NoDescription(Options):
    distance_m: float = 1.0


def options_of_a_function() -> type[Options]:
    class Local(Options):
        distance_m: float = Field(1.0, description="how far")

    return Local


class Remembers(Completer):
    calls = 0

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        self.calls += 1
        return PointCloud(cloud.points + self.calls)


class RemembersPoints(Completer):
    """Returns all that it has seen of a room: the second time it knows the other half, too."""

    seen = np.empty((0, 3))

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        self.seen = np.unique(np.concatenate([self.seen, cloud.points]), axis=0)
        return PointCloud(self.seen)


class RemembersColoredPoints(RemembersPoints):
    needs_color = True


def with_noise(rng: np.random.Generator, cloud: PointCloud) -> PointCloud:
    return PointCloud(cloud.points + rng.normal(size=cloud.points.shape))


def in_place(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    cloud.points.flags.writeable = True
    cloud.points[:] += 1.0
    return cloud


def single_precision(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    return PointCloud(cloud.points.astype(np.float32).astype(np.float64))


def needs_a_hundred(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    if len(cloud) < 100:
        raise IndexError("list index out of range")
    return cloud


def skips_below_a_hundred(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    if len(cloud) < 100:
        raise Skipped("fewer than 100 points")
    return cloud


def raises(error: BaseException) -> Callable[..., Any]:
    def complete(*_: object) -> None:
        raise error

    return complete


class Unspeakable(Exception):
    def __str__(self) -> str:
        raise RuntimeError


FAULTY_COMPLETERS = {
    "must return a PointCloud, not ndarray": completer(lambda cloud, rng: cloud.points),
    "returned an empty cloud": completer(lambda cloud, rng: cloud.select(np.zeros(len(cloud), bool))),
    "take randomness from the rng alone": completer(lambda cloud, rng: with_noise(np.random.default_rng(), cloud)),
    "for the same input and rng": Remembers,
    "and remember no cloud": RemembersPoints,
    "alone, and remember no cloud": RemembersColoredPoints,
    "centre the points before float32": completer(single_precision),
    "one point: IndexError": completer(needs_a_hundred),
    "option distance_m needs a default": completer(lambda cloud, rng: cloud, Options=NoDefault),
    "option distance_m needs a description": completer(lambda cloud, rng: cloud, Options=NoDescription),
    "SHA-256": completer(lambda cloud, rng: cloud, weights_digest=lambda self: "v2-final"),
    "SHA-256 as a text in hex, not b'00": completer(lambda cloud, rng: cloud, weights_digest=lambda self: b"0" * 64),
    "define Options in the plugin's class": completer(lambda cloud, rng: cloud, Options=options_of_a_function()),
    "call super().__init__(options)": completer(lambda cloud, rng: cloud, __init__=lambda self: None),
    "version must be": completer(lambda cloud, rng: cloud, version=2),
    "Faulty.costs must be some of": completer(lambda cloud, rng: cloud, costs="seconds"),
    "Faulty.complete(): ValueError: no plane in sight": completer(raises(ValueError("no plane\nin sight"))),
    "Faulty.complete(): SystemExit: 0": completer(raises(SystemExit(0))),
    "Faulty.complete(): AssertionError": completer(raises(AssertionError())),
    "Faulty.complete(): Unspeakable: (its message cannot be shown)": completer(raises(Unspeakable())),
    "Faulty skips the room that it is tried on (too few)": completer(raises(Skipped("too few"))),
    "are not finite": completer(lambda cloud, rng: PointCloud(cloud.points * np.nan)),
    "Faulty.complete(): CloudError: points must have shape (N, 3)": completer(
        lambda cloud, rng: PointCloud(cloud.points[:, :2])
    ),
    "Faulty(): ImportError: no torch_scatter": completer(
        lambda cloud, rng: cloud, __init__=lambda self: raises(ImportError("no torch_scatter"))(self)
    ),
    "Faulty wrote into the cloud it was given": completer(in_place),
    "must return two things": completer(
        lambda cloud, rng: cloud, complete_with_confidence=lambda self, cloud, rng: cloud
    ),
    "model_card() has another trained_on": completer(
        lambda cloud, rng: cloud, model_card=lambda self: {"trained_on": "indoor"}
    ),
}


@pytest.mark.parametrize("says", FAULTY_COMPLETERS)
def test_a_completer_that_breaks_its_contract_is_told_how(says: str) -> None:
    made = FAULTY_COMPLETERS[says]
    if made.Options is NoDefault:
        made = made(NoDefault(distance_m=1.0))  # type: ignore[assignment]
    with pytest.raises(AssertionError) as caught:
        check_completer(made)
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_numpys_global_generator_is_not_a_source_of_randomness() -> None:
    legacy = completer(lambda cloud, rng: PointCloud(cloud.points + np.random.rand()))  # noqa: NPY002
    with pytest.raises(AssertionError, match="rng alone"):
        check_completer(legacy)


class Sure(Completer):
    """Returns its input with a confidence; what exactly can be replaced."""

    def __init__(self, confidence: Callable[[int], Any], moved_m: float = 0.0) -> None:
        super().__init__()
        self.confidence, self.moved_m = confidence, moved_m

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        return cloud

    def complete_with_confidence(self, cloud: PointCloud, rng: np.random.Generator) -> Any:
        return PointCloud(cloud.points + self.moved_m), self.confidence(len(cloud))


@pytest.mark.parametrize(
    ("completer", "says"),
    [
        (Sure(np.zeros, moved_m=0.1), "must return the same cloud"),
        (Sure(lambda count: np.ones((count, 1))), "must give one number a point"),
        (Sure(lambda count: np.full(count, np.nan)), r"must stay in \[0, 1\]"),
        (Sure(lambda count: [None] * count), "give None for all points where it cannot say"),
        (Sure(lambda count: ["high"] * count), "its confidence is not numbers"),
        (Sure(lambda count: [[1.0], [1.0, 2.0]]), "its confidence is not numbers"),
    ],
)
def test_a_confidence_that_breaks_its_contract_is_told_how(completer: Completer, says: str) -> None:
    check_completer(Sure(np.ones))
    with pytest.raises(AssertionError, match=says):
        check_completer(completer)


def test_a_completer_that_wants_color_must_say_so() -> None:
    def gray(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        return PointCloud(cloud.points, cloud.colors.mean(axis=1, keepdims=True).repeat(3, axis=1))  # type: ignore[union-attr]

    with pytest.raises(AssertionError, match=r"AttributeError: .*without colour: set needs_color"):
        check_completer(completer(gray))
    check_completer(completer(gray, needs_color=True))


def test_skipping_what_is_too_small_is_fine_and_the_rng_may_be_used() -> None:
    check_completer(completer(skips_below_a_hundred))
    check_completer(completer(lambda cloud, rng: cloud.select(rng.permutation(len(cloud)))))


class GapToTruth(Task):
    """Mean distance from the truth to the completed cloud: a task as it should be."""

    metrics = (Metric("gap_m", "m", "lower", "mean over complete points of the distance to the completed cloud"),)

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        return Measurements({"gap_m": nearest(case.scene.complete.points, completed.points)[0].tolist()})


def task(measure: Callable[[Case, PointCloud, np.random.Generator], Any], **attributes: Any) -> type[Task]:
    """The task above, measuring something else."""
    body = {"evaluate": lambda self, case, completed, rng: measure(case, completed, rng), **attributes}
    return type("Faulty", (GapToTruth,), body)


def gap(*values: float, **more: Any) -> Measurements:
    return Measurements({"gap_m": list(values)}, **more)


METRIC = GapToTruth.metrics[0]
FAULTY_TASKS = {
    "cannot tell them apart": task(lambda case, completed, rng: gap(1.0)),
    "must return pcdbench.Measurements, not float": task(lambda case, completed, rng: 1.0),
    "returned 'other', which its `metrics` do not declare": task(lambda *_: Measurements({"other": [1.0]})),
    "the task returned no samples of 'gap_m'": task(lambda *_: Measurements({})),
    "declares ['gap_m', 'more_m'] but measures ['gap_m']": task(
        lambda *_: gap(1.0), metrics=(METRIC, Metric("more_m", "m", "lower", "another one"))
    ),
    "samples of 'gap_m' are not finite": task(lambda case, completed, rng: gap(float("nan"))),
    "must be a sequence of numbers, not of shape ()": task(lambda *_: Measurements({"gap_m": 0.1})),  # type: ignore[dict-item]
    "the samples of 'gap_m' are not numbers": task(lambda *_: Measurements({"gap_m": ["far"]})),  # type: ignore[list-item]
    "the samples must be a dict, not list": task(lambda *_: Measurements([0.1])),  # type: ignore[arg-type]
    "raise pcdbench.Skipped where there are none": task(lambda case, completed, rng: gap()),
    "one label a sample": task(lambda case, completed, rng: gap(1.0, labels={"gap_m": ["a", "b"]})),
    "must be a list with one label a sample": task(lambda case, completed, rng: gap(1.0, labels={"gap_m": 3})),
    "labels ['gap'], of which it has no samples": task(lambda case, completed, rng: gap(1.0, labels={"gap": ["a"]})),
    "plain numbers": task(lambda case, completed, rng: gap(1.0, trace={"path": np.zeros(3)})),
    "for the same rng": task(lambda case, completed, rng: gap(np.random.default_rng().random())),
    "Faulty.evaluate(): KeyError: 'wall'": task(raises(KeyError("wall"))),
    "Faulty.evaluate(): SystemExit": task(raises(SystemExit(0))),
    "Faulty skips the room that it is tried on (no surface)": task(raises(Skipped("no surface"))),
    "must be a tuple of pcdbench.Metric": task(lambda *_: gap(1.0), metrics=("gap_m",)),
    "metrics is empty": task(lambda *_: gap(1.0), metrics=()),
    "names a metric twice": task(lambda *_: gap(1.0), metrics=(METRIC, METRIC)),
    "needs a unit and a formula": task(lambda *_: gap(1.0), metrics=(Metric("gap_m", "m", "lower", ""),)),
}


@pytest.mark.parametrize("says", FAULTY_TASKS)
def test_a_task_that_breaks_its_contract_is_told_how(says: str) -> None:
    with pytest.raises(AssertionError) as caught:
        check_task(FAULTY_TASKS[says])
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_a_good_task_passes_and_the_same_with_its_direction_wrong_does_not() -> None:
    check_task(GapToTruth)
    wrong = task(GapToTruth().evaluate, metrics=(Metric("gap_m", "m", "higher", METRIC.formula, "mean"),))
    with pytest.raises(AssertionError, match=r"gap_m \(higher is better\)"):
        check_task(wrong)


def test_the_small_room_is_a_scene_like_any(room: Scene) -> None:
    assert (len(room.complete), len(room.dense), len(room.objects)) == (4000, 40_000, 4)
    np.testing.assert_array_equal(room.complete.points, room.dense.points[room.complete_index])
    np.testing.assert_array_equal(small_room().dense.points, room.dense.points)
    assert not np.array_equal(small_room(seed=1).dense.points, room.dense.points)
    for tagged in room.objects:
        assert tagged.box.contains(room.complete.points, margin_m=1e-6).sum() > 10


def test_the_small_rooms_points_lie_on_its_mesh(room: Scene) -> None:
    assert room.surface is not None
    corners = room.surface.vertices[room.surface.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    heights = np.abs(np.einsum("ptk,tk->pt", room.complete.points[:200, None] - corners[:, 0], normals))
    assert heights.min(axis=1).max() < 1e-6
