"""For plugin authors: `check_completer` and `check_task` hold a plugin to its contract, in one line and without data.

>>> from pcdbench.testing import check_completer
>>> check_completer(MyCompleter)  # doctest: +SKIP
"""

from __future__ import annotations

import json
import pickle
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pcdbench.case import Case
from pcdbench.cloud import PointCloud
from pcdbench.completer import Completer, ReferenceCompleter
from pcdbench.errors import PluginError, Skipped, told
from pcdbench.geometry.neighbors import nearest
from pcdbench.keys import canonical_json
from pcdbench.options import Options
from pcdbench.runner.cards import checked_card, require_known_splits
from pcdbench.runner.rows import samples_by_metric
from pcdbench.scene import Box, Scene, Surface, TaggedObject
from pcdbench.task import Measurements, Metric, Task

_MAP_OFFSET_M = np.array([2.0**20, -(2.0**20), 2.0**10])
_HALVES = 3
_OR_SKIP = "; raise pcdbench.Skipped where nothing can be done"

Plugin = TypeVar("Plugin", Completer, Task)
T = TypeVar("T")


def _nowhere(_: str) -> None:
    """Tests need no report of what holds."""


def check_completer(
    completer: Completer | type[Completer], *, scene: Scene | None = None, report: Callable[[str], None] = _nowhere
) -> None:
    """Hold a completer to its contract on small generated clouds.

    It must return a cloud, give the same one for the same rng whatever it did before, leave its input alone,
    manage without colour (unless it declares `needs_color`) and with one point, two, a line, or many at one
    place (or raise `pcdbench.Skipped`), and keep millimetres in map coordinates of 10^6 m. Its options must
    have defaults and descriptions. If it knows its confidence, that is a number in [0, 1] for each point of the
    same cloud.

    Args:
        completer: the class, built with its default options, or an instance.
        scene: what to complete; `small_room()` unless given.
        report: takes a line for each thing that holds.

    Raises:
        AssertionError: with one line that says what does not hold.
    """
    completer = _built(completer)
    who = type(completer).__name__
    _check_declaration(who, completer)
    digest = called(f"{who}.weights_digest()", completer.weights_digest)
    _require(
        digest is None or (isinstance(digest, str) and re.fullmatch("[0-9a-f]{64}", digest) is not None),
        f"{who}.weights_digest() must be None or a SHA-256 as a text in hex, not {digest!r}",
    )
    _check_card(who, completer)
    _require(set(completer.costs) <= set(Completer.costs), f"{who}.costs must be some of {Completer.costs}")
    report("version, options, weights' digest and model card can be shown and recorded")
    scene = scene or small_room()
    case = half_missing(scene, seed=0)
    if isinstance(completer, ReferenceCompleter):

        def answered(rng: np.random.Generator) -> PointCloud:
            with _not_skipped(who):
                return called(f"{who}.answer()", completer.answer, case, rng)

        _check_repeats(who, answered, lambda: None, scene.dense, scene.complete)
        report("the same answer for the same rng, and the case as it was")
        return
    cloud = case.cloud
    # Another half of the same room in between shows what leaks from one cell into the next, remembered points too.
    other = half_missing(scene, seed=1).cloud
    other = other if completer.needs_color else other.without_colors()

    colorless = "" if completer.needs_color else " (of a cloud without colour: set needs_color if that is why)"

    def completed(rng: np.random.Generator) -> PointCloud:
        with _not_skipped(who):
            return called(f"{who}.complete()", completer.complete, cloud, rng)

    def complete_other() -> None:
        with _not_skipped(who):
            called(f"{who}.complete()", completer.complete, other, np.random.default_rng(99), cure=colorless)

    result = _check_repeats(who, completed, complete_other, cloud, other)
    report("the same cloud for the same rng, whatever came before, and the input as it was")
    _check_confidence(who, completer, cloud, result)
    report("complete_with_confidence() returns the same cloud, and a confidence in [0, 1] or none")
    for name, tiny in _tiny_clouds(completer.needs_color):
        try:
            returned = called(f"{who} on {name}", completer.complete, tiny, np.random.default_rng(0), cure=_OR_SKIP)
        except Skipped:
            continue
        _require_cloud(f"{who} on {name}", returned)
    report("one point, two, a line and fifty at one place are completed or skipped")
    far = PointCloud(cloud.points + _MAP_OFFSET_M, cloud.colors)
    who = f"{who} at map coordinates of 10^6 m"
    with _not_skipped(who):
        returned = _require_cloud(who, called(who, completer.complete, far, np.random.default_rng(0)))
    moved = returned.points - _MAP_OFFSET_M
    off_m = max(np.median(nearest(moved, result.points)[0]), np.median(nearest(result.points, moved)[0]))
    _require(
        off_m < 1e-3,
        f"{who} is off by {off_m * 1000:.1f} mm; centre the points before float32",
    )
    report("map coordinates of 10^6 m keep their millimetres")


def check_task(
    task: Task | type[Task], *, scene: Scene | None = None, report: Callable[[str], None] = _nowhere
) -> None:
    """Hold a task to its contract on a small generated room.

    It must measure exactly the metrics it declares, in finite numbers, the same ones for the same rng; leave
    case and cloud alone; bear a completed cloud of one point and one without colour (or raise
    `pcdbench.Skipped`); and its main metric must be better for the truth than for half of it.

    Args:
        task: the class, built with its default options, or an instance.
        scene: what to measure; `small_room()` unless given.
        report: takes a line for each thing that holds.

    Raises:
        AssertionError: with one line that says what does not hold.
    """
    task = _built(task)
    who = type(task).__name__
    _check_declaration(who, task)
    _check_metrics(who, task.metrics)
    report("version, options and metrics can be shown and recorded")
    scene = scene or small_room()
    halves = [half_missing(scene, seed=draw) for draw in range(_HALVES)]
    with _not_skipped(who):
        truth = [_measure(who, task, case, scene.complete) for case in halves]
    with _global_randomness(1), _not_skipped(who):
        again = _measure(who, task, halves[0], scene.complete)
    # Sums of threads differ in their last digits; anything more is randomness from elsewhere.
    for name, samples in truth[0].items():
        _require(
            len(samples) == len(again[name]) and np.allclose(samples, again[name], 1e-6, 1e-9),
            f"{who}: {name} has other values for the same rng; use no other randomness",
        )
    report("the declared metrics, finite, the same for the same rng, and case and cloud as they were")
    one_point = scene.complete.select(np.arange(1))
    odd = {"one point": one_point} | ({} if task.needs_color else {"no colour": scene.complete.without_colors()})
    for name, cloud in odd.items():
        try:
            _measure(f"{who} on a completed cloud of {name}", task, halves[0], cloud)
        except Skipped:
            continue
    report("completed clouds of one point, and without colour, are measured or skipped")
    with _not_skipped(who):
        floor = [_measure(who, task, case, case.cloud) for case in halves]
    main = task.metrics[0]
    best, worst = _figure(main, truth), _figure(main, floor)
    _require(
        best < worst if main.direction == "lower" else best > worst,
        f"{who}: {main.name} ({main.direction} is better) is {best:.4g} for the truth and {worst:.4g} for half of it; "
        "a task that cannot tell them apart measures nothing",
    )
    report(f"{main.name} is better for the truth ({best:.4g}) than for half of it ({worst:.4g})")


def half_missing(scene: Scene, seed: int) -> Case:
    """The scene without the half of its points that lies nearest to one of them, drawn by `seed`."""
    points = scene.complete.points
    around = points[np.random.default_rng(seed).integers(len(points))]
    order = np.argsort(np.linalg.norm(points - around, axis=1), kind="stable")
    kept = np.ones(len(points), dtype=bool)
    kept[order[: len(points) // 2]] = False
    return Case(scene, "half_missing", 0.5, seed, kept)


def small_room(points: int = 4000, seed: int = 0) -> Scene:
    """A furnished, textured room of 5 x 4 x 2.5 m, sampled evenly: enough to try a plugin on.

    Args:
        points: of the complete cloud; the dense one has ten times as many.
    """
    rng = np.random.default_rng(seed)
    corners, colors = _room_faces()
    areas = np.linalg.norm(np.cross(corners[:, 1], corners[:, 2]), axis=1)
    face = rng.choice(len(corners), 10 * points, p=areas / areas.sum())
    along = rng.random((10 * points, 2))
    offset = along[:, :1] * corners[face, 1] + along[:, 1:] * corners[face, 2]
    # Rounded to 2^-20 m, so that moving the room to map coordinates is exact.
    xyz = np.round((corners[face, 0] + offset) * 2**20) / 2**20
    tiles = np.floor(offset / 0.4 + 1e-9).sum(axis=1) % 2
    stripes = 0.1 * np.sin(offset @ np.array([9.0, 7.0, 5.0]))
    rgb = np.clip(colors[face] * (0.7 + 0.3 * tiles)[:, None] + stripes[:, None], 0, 1)
    dense = PointCloud(xyz, rgb)
    index = np.sort(rng.choice(len(dense), points, replace=False))
    origin, u, v = corners[:, 0], corners[:, 1], corners[:, 2]
    vertices = np.stack([origin, origin + u, origin + u + v, origin + v], axis=1).reshape(-1, 3)
    first = 4 * np.arange(len(corners))[:, None]
    triangles = (first[:, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    surface = Surface(vertices, triangles, np.zeros(len(triangles), dtype=bool))
    objects = tuple(TaggedObject(label, Box((low + high) / 2, high - low)) for label, low, high, _ in _furniture())
    return Scene("small-room", dense.select(index), dense, index, objects, surface, source=f"small_room, seed {seed}")


def _furniture() -> list[tuple[str, NDArray, NDArray, tuple[float, float, float]]]:
    """Label, lowest and highest corner (metres), colour."""
    boxes = [
        ("cabinet", (0.0, 0.5, 0.0), (0.6, 1.7, 1.8), (0.6, 0.4, 0.2)),
        ("table", (2.6, 1.4, 0.0), (4.0, 2.2, 0.75), (0.8, 0.7, 0.4)),
        ("radiator", (2.0, 3.85, 0.1), (3.6, 4.0, 0.9), (0.9, 0.9, 0.9)),
        ("bin", (4.6, 3.6, 0.0), (4.9, 3.9, 0.4), (0.2, 0.3, 0.7)),
    ]
    return [(label, np.array(low), np.array(high), color) for label, low, high, color in boxes]


def _room_faces() -> tuple[NDArray, NDArray]:
    """Faces as (F, 3, 3): a corner and two edges, metres; and their colours (F, 3)."""
    room = (np.zeros(3), np.array([5.0, 4.0, 2.5]))
    shells = [(*room, (0.75, 0.7, 0.65))] + [(low, high, color) for _, low, high, color in _furniture()]
    faces = []
    colors = []
    for low, high, color in shells:
        edges = np.diag(high - low)
        for axis in range(3):
            u, v = np.delete(edges, axis, axis=0)
            for side in (low, low + edges[axis]):
                faces.append((side, u, v))
                # Every side its own tint: a room whose walls look alike says little about colour.
                tint = 1.0 + 0.15 * (axis - 1) + (0.08 if side is low else -0.08)
                colors.append(np.clip(np.array(color) * tint, 0, 1))
    return np.array(faces), np.array(colors)


def _tiny_clouds(colored: bool) -> Iterator[tuple[str, PointCloud]]:
    line = np.linspace(0, 1, 50)[:, None] * np.array([1.0, 0.5, 0.0])
    for name, points in (
        ("one point", line[:1]),
        ("two points", line[:2]),
        ("points on a line", line),
        ("fifty points at one place", np.repeat(line[7:8], 50, axis=0)),
    ):
        yield name, PointCloud(points, np.full(points.shape, 0.5) if colored else None)


def _check_declaration(who: str, plugin: Completer | Task) -> None:
    """What every plugin declares: a version, and options that can be shown, recorded and sent to a worker."""
    _require(isinstance(plugin.version, str) and plugin.version != "", f"{who}.version must be a text such as '1'")
    model = plugin.Options
    subclass = isinstance(model, type) and issubclass(model, Options)
    _require(subclass, f"{who}.Options must be a subclass of pcdbench.Options")
    _require(bool(model.model_config.get("frozen")), f"{who}.Options must stay frozen")
    for name, field in model.model_fields.items():
        _require(not field.is_required(), f"{who}: option {name} needs a default")
        _require(bool(field.description), f"{who}: option {name} needs a description: Field(..., description=...)")
    _require(
        isinstance(getattr(plugin, "options", None), model),
        f"{who}.options must be an instance of {who}.Options; call super().__init__(options)",
    )
    text = called(f"{who}: options as JSON", lambda: canonical_json(plugin.options.model_dump(mode="json")))
    _require(
        called(f"{who}: options read back", model.model_validate, json.loads(text)) == plugin.options,
        f"{who}: options do not survive being written as JSON and read back",
    )
    unpickled = called(
        f"{who}: options pickled and read back",
        lambda: pickle.loads(pickle.dumps(plugin.options)),
        cure="; define Options in the plugin's class or in its module, not in a function",
    )
    _require(unpickled == plugin.options, f"{who}: options do not survive being pickled")


def _check_metrics(who: str, metrics: tuple[Metric, ...]) -> None:
    _require(
        isinstance(metrics, Sequence) and all(isinstance(metric, Metric) for metric in metrics),
        f"{who}.metrics must be a tuple of pcdbench.Metric, not {metrics!r}",
    )
    names = [metric.name for metric in metrics]
    _require(bool(names), f"{who}.metrics is empty; declare at least one pcdbench.Metric")
    _require(len(set(names)) == len(names), f"{who}.metrics names a metric twice: {names}")
    for metric in metrics:
        _require(bool(metric.unit and metric.formula), f"{who}: metric {metric.name} needs a unit and a formula")
        _require(metric.direction in ("lower", "higher"), f"{who}: {metric.name}: which direction is better?")
        _require(metric.summary in ("median", "mean"), f"{who}: {metric.name}: is its summary the median or the mean?")


def _check_repeats(
    who: str,
    make: Callable[[np.random.Generator], PointCloud],
    between: Callable[[], None],
    *inputs: PointCloud,
) -> PointCloud:
    """The cloud that `make(rng)` returns, the same before and after `between()`, with its inputs as they were."""
    before = [(cloud.points.copy(), None if cloud.colors is None else cloud.colors.copy()) for cloud in inputs]
    with _global_randomness(0):
        first = _require_cloud(who, make(np.random.default_rng(0)))
        between()
    for cloud, (points, colors) in zip(inputs, before, strict=True):
        same_colors = colors is None or (cloud.colors is not None and np.array_equal(cloud.colors, colors))
        _require(
            np.array_equal(cloud.points, points) and same_colors,
            f"{who} wrote into the cloud it was given, which others are given, too; change a copy of its arrays",
        )
    with _global_randomness(1):
        second = _require_cloud(who, make(np.random.default_rng(0)))
    same_colors = first.colors is second.colors is None or (
        first.colors is not None and second.colors is not None and np.array_equal(first.colors, second.colors)
    )
    _require(
        np.array_equal(first.points, second.points) and same_colors,
        f"{who} gave two clouds for the same input and rng; take randomness from the rng alone, and remember no cloud",
    )
    return first


def _measure(who: str, task: Task, case: Case, completed: PointCloud) -> dict[str, list[float]]:
    """The samples by metric of one cloud, shown to be what was declared, with case and cloud as they were."""
    looked_at = [case.kept, case.scene.complete.points, case.scene.dense.points, completed.points]
    before = [array.copy() for array in looked_at]
    result = called(f"{who}.evaluate()", task.evaluate, case, completed, np.random.default_rng(case.seed))
    _require(isinstance(result, Measurements), f"{who} must return pcdbench.Measurements, not {type(result).__name__}")
    try:
        row = samples_by_metric(task, result)
    except PluginError as error:
        raise AssertionError(f"{who}: {error}") from None
    measured: dict[str, list[float]] = {name: metric["samples"] for name, metric in row["metrics"].items()}
    declared = [metric.name for metric in task.metrics]
    _require(set(declared) == set(measured), f"{who} declares {sorted(declared)} but measures {sorted(measured)}")
    for name, samples in measured.items():
        _require(
            len(samples) > 0, f"{who}: {name} has no samples; raise pcdbench.Skipped where there is nothing to say"
        )
    unknown = [name for name in result.labels if name not in measured]
    _require(not unknown, f"{who} labels {unknown}, of which it has no samples")
    _require_json(result)
    for array, copy in zip(looked_at, before, strict=True):
        _require(np.array_equal(array, copy), f"{who} changed what it measured")
    return measured


def _require_json(result: Measurements) -> None:
    labels = {name: list(values) for name, values in result.labels.items()}
    try:
        canonical_json([labels, dict(result.trace)])
    except (TypeError, ValueError) as error:
        raise AssertionError(f"measurements must be plain numbers, lists and texts: {error}") from error


def _figure(metric: Metric, results: Sequence[Mapping[str, Sequence[float]]]) -> float:
    samples = np.concatenate([result[metric.name] for result in results])
    return float(np.median(samples) if metric.summary == "median" else np.mean(samples))


@contextmanager
def _global_randomness(seed: int) -> Iterator[None]:
    """NumPy's global generator in another state, so that whoever draws from it is found out."""
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(seed)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002


def _check_confidence(who: str, completer: Completer, cloud: PointCloud, result: PointCloud) -> None:
    """Hold `complete_with_confidence` to the cloud that `complete` returned for the same rng."""
    who = f"{who}.complete_with_confidence()"
    with _not_skipped(who):
        answer: object = called(who, completer.complete_with_confidence, cloud, np.random.default_rng(0))
    if not (isinstance(answer, tuple) and len(answer) == 2):
        raise AssertionError(f"{who} must return two things, the cloud and its confidence (or None)")
    same, confidence = _require_cloud(who, answer[0]), answer[1]
    _require(np.array_equal(same.points, result.points), f"{who} and complete() must return the same cloud")
    if confidence is None:
        return
    wanted = f"{who} must give one number a point, ({len(same)},)"
    try:
        numbers = np.asarray(confidence, float)
    except (TypeError, ValueError) as error:
        raise AssertionError(f"{wanted}; its confidence is not numbers ({error})") from None
    _require(numbers.shape == (len(same),), f"{wanted}, not {numbers.shape}")
    within = (numbers >= 0) & (numbers <= 1)
    _require(bool(within.all()), f"{who} must stay in [0, 1]; give None for all points where it cannot say")


def _check_card(who: str, completer: Completer) -> None:
    card = called(f"{who}.model_card()", completer.model_card)
    try:
        require_known_splits(who, checked_card(who, card))
    except PluginError as error:
        raise AssertionError(str(error)) from None


def _built(plugin: Plugin | type[Plugin]) -> Plugin:
    """The plugin, built with its default options where its class is given."""
    return called(f"{plugin.__name__}()", plugin) if isinstance(plugin, type) else plugin


@contextmanager
def _not_skipped(who: str) -> Iterator[None]:
    """A room is no reason to skip."""
    try:
        yield
    except Skipped as reason:
        raise AssertionError(
            f"{who} skips the room that it is tried on ({reason}); give a scene= that it takes"
        ) from None


def called(who: str, call: Callable[..., T], *given: Any, cure: str = "") -> T:
    """What `call(*given)` returns, where `call` is a plugin's own; `Skipped` passes, all else is told in one line.

    Raises:
        AssertionError: naming whom it is from and what it raised, a `SystemExit` too.
    """
    try:
        return call(*given)
    except (Skipped, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise AssertionError(f"{who}: {told(error)}{cure}") from error


def _require_cloud(who: str, result: object) -> PointCloud:
    if not isinstance(result, PointCloud):
        raise AssertionError(f"{who} must return a PointCloud, not {type(result).__name__}")
    _require(len(result) > 0, f"{who} returned an empty cloud; raise pcdbench.Skipped where nothing can be done")
    return result


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise AssertionError(otherwise)
