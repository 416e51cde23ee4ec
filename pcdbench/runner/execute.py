"""One cell: make its case, complete it, measure it by every task; whatever goes wrong costs its own rows alone."""

from __future__ import annotations

import traceback
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np

from pcdbench.case import Case, make_case
from pcdbench.cloud import PointCloud
from pcdbench.completer import Completer, ReferenceCompleter
from pcdbench.dataset import Dataset
from pcdbench.errors import PcdbenchError, PluginError, Skipped, told
from pcdbench.geometry.duplicates import share_held
from pcdbench.keys import digest, seed_from
from pcdbench.runner.completions import Completion, CompletionCache
from pcdbench.runner.measuring import Cost
from pcdbench.runner.plan import Cell
from pcdbench.runner.rows import FOREKNOWN, Row, base_row, new_row, samples_by_metric
from pcdbench.runner.selection import Plugin
from pcdbench.scene import Scene
from pcdbench.task import Measurements, Task

Stage = Literal["scene", "case", "completing", "evaluating"]
_KEPT_SCENES = 2
_TRACEBACK_LINES = 12
# Coordinates that a file rounded may meet by chance.
_FOREKNOWN_FROM = 0.01
T = TypeVar("T")


@dataclass(eq=False)
class Failure(Exception):
    """Why rows have no measurements."""

    status: Literal["failed", "skipped"]
    stage: Stage
    error: str
    detail: str | None = None


@dataclass(frozen=True)
class Step:
    """What a step of a cell gave.

    Attributes:
        facts: what is known by now of all rows of the cell.
        rows: those that are finished.
    """

    facts: Row
    rows: Sequence[Row] = ()


class Executor:
    """Runs cells of one data set, one after the other; remembers the last scenes, cases and completers."""

    def __init__(self, dataset: Plugin, cache: CompletionCache) -> None:
        self._dataset = dataset
        self._cache = cache
        self._kept: dict[str, OrderedDict[Hashable, Any]] = {}

    def rows(self, cell: Cell, tasks: Sequence[Plugin]) -> list[Row]:
        """One row for each task, whatever happens; nothing but KeyboardInterrupt is raised."""
        return [row for step in self.steps(cell, tasks) for row in step.rows]

    def steps(self, cell: Cell, tasks: Sequence[Plugin]) -> Iterator[Step]:
        """A cell step by step: making its scene, then its case, completing it, evaluating it by each task."""
        base = base_row(self._dataset, cell)
        try:
            self._scene(cell)
            yield Step(base)
            case = self.case(cell)
            yield Step(base)
            completion, cached = self.completion(cell, case)
        except Failure as failure:
            yield Step(base, [_failed_row(base, cell, task, failure) for task in tasks])
            return
        base |= {
            "points": {
                "complete": len(case.scene.complete),
                "incomplete": len(case.cloud),
                "completed": len(completion.cloud),
            },
            "missing": case.level,
            "completing": {key: completion.facts[key] for key in ("seconds", "peak_memory_mb")} | {"cached": cached},
            "device": completion.facts["device"],
        }
        if not cell.completer.reference:
            share = share_held(completion.cloud.points, case.removed.points, case.cloud.points)
            base |= {FOREKNOWN: round(share, 4)} if share >= _FOREKNOWN_FROM else {}
        yield Step(base)
        for task in tasks:
            yield Step(base, [self._measured_row(base, cell, task, case, completion.cloud)])

    def case(self, cell: Cell) -> Case:
        """The case of a cell.

        Raises:
            Failure: where the scene or the case cannot be made.
        """
        scene = self._scene(cell)
        incompleteness = cell.incompleteness

        def make() -> Case:
            maker = self._remember("incompleteness", incompleteness.identity, lambda: _as_planned(incompleteness))
            case = make_case(scene, incompleteness.name, maker, cell.level, cell.seed)
            if not case.kept.any():
                raise Skipped(f"nothing is left of {cell.scene} at level {cell.level:g}")
            return case

        return self._remember("case", cell.case, lambda: _at("case", make))

    def completion(self, cell: Cell, case: Case) -> tuple[Completion, bool]:
        """The completed cloud, and whether it came from the cache.

        Raises:
            Failure: where the completer cannot complete the case.
        """
        plugin = cell.completer
        # What decides the input counts with its code, too: an incompleteness may be what is being developed.
        cache_key = digest([cell.key, self._dataset.code, cell.incompleteness.code, plugin.code])
        if not plugin.reference:
            found = self._cache.get(cache_key)
            if found is not None:
                return found, True
        completer = self._remember("completer", plugin.identity, lambda: _at("completing", lambda: _as_planned(plugin)))
        rng = np.random.default_rng(seed_from("completer", cell.key))
        completion = _at("completing", lambda: completed(completer, case, rng))
        if not plugin.reference:
            self._cache.put(cache_key, completion)
        return completion, False

    def _measured_row(self, base: Row, cell: Cell, task: Plugin, case: Case, cloud: PointCloud) -> Row:
        cost = Cost()
        try:
            evaluator = self._remember("task", task.identity, lambda: _at("evaluating", lambda: _as_planned(task)))
            samples = _at("evaluating", lambda: measured(evaluator, cell, task, case, cloud, cost))
        except Failure as failure:
            return _failed_row(base, cell, task, failure) | {"evaluating": cost.as_json()}
        return new_row(base, cell, task) | {"status": "ok", "evaluating": cost.as_json()} | samples

    def _scene(self, cell: Cell) -> Scene:
        return self._remember("scene", cell.scene, lambda: _at("scene", lambda: self._made_scene(cell)))

    def _made_scene(self, cell: Cell) -> Scene:
        """The scene of a cell.

        Raises:
            PcdbenchError: where it cannot be made, or is not what the cell's key says: a file has changed since the
                run was planned, or is another one on this machine.
        """
        dataset = self._open()
        if dataset.digest(cell.scene) != cell.scene_digest:
            raise PcdbenchError(
                f"the files of {cell.scene} are not those that the run was planned with; give the command again, "
                "or the same files to all machines"
            )
        return dataset.scene(cell.scene)

    def _open(self) -> Dataset:
        return self._remember("dataset", self._dataset.identity, lambda: _as_planned(self._dataset))

    def _remember(self, kind: str, key: Hashable, make: Callable[[], T]) -> T:
        """What `make` gave for this key before, or gives now, a failure too; few scenes and cases, every plugin."""
        kept = self._kept.setdefault(kind, OrderedDict())
        if key not in kept:
            try:
                kept[key] = make()
            except Failure as failure:
                kept[key] = replace(failure)
            if kind in ("scene", "case") and len(kept) > _KEPT_SCENES:
                kept.popitem(last=False)
        kept.move_to_end(key)
        if isinstance(kept[key], Failure):
            # A new one each time: what is raised holds the frames that it passes, with their cases and clouds.
            raise replace(kept[key])
        return kept[key]


def completed(completer: Completer, case: Case, rng: np.random.Generator) -> Completion:
    """A completer's answer to a case, checked, and what it cost.

    Raises:
        Skipped: where the completer needs colour and the case has none.
        PluginError: where what it returned is not a cloud with points.
    """
    incomplete = case.cloud
    if completer.needs_color and incomplete.colors is None:
        raise Skipped("the completer needs colour and the cloud has none")
    with Cost() as cost:
        cloud: Any = (
            completer.answer(case, rng)
            if isinstance(completer, ReferenceCompleter)
            else completer.complete(incomplete, rng)
        )
    if not isinstance(cloud, PointCloud):
        raise PluginError(f"the completer returned {type(cloud).__name__}, not a pcdbench.PointCloud")
    # A subclass may count its points otherwise than the cap does, and arrays may have changed since they were checked.
    cloud = PointCloud(cloud.points, cloud.colors)
    if not len(cloud):
        raise PluginError("the completer returned a cloud without points")
    costs = {name: value if name in completer.costs else None for name, value in cost.as_json().items()}
    return Completion(cloud, costs | {"device": str(getattr(completer, "device", "cpu"))})


def measured(evaluator: Task, cell: Cell, task: Plugin, case: Case, cloud: PointCloud, cost: Cost) -> Row:
    """A task's measurements of a completed cloud as the row keeps them; `cost` takes what they cost.

    Raises:
        Skipped: where the task needs colour and there is none, or says so itself.
        PluginError: where what it returned breaks its contract.
    """
    if evaluator.needs_color:
        for which, its in (("completed", cloud), ("complete", case.scene.complete)):
            if its.colors is None:
                raise Skipped(f"the task needs colour and the {which} cloud has none")
    if evaluator.caps_density and len(cloud) > len(case.scene.complete):
        drawn = np.random.default_rng(seed_from("cap", cell.key))
        cloud = cloud.select(np.sort(drawn.permutation(len(cloud))[: len(case.scene.complete)]))
    # Neither the completer nor the level is in this seed: all of a draw's clouds are measured alike.
    rng = np.random.default_rng(seed_from("task", cell.seed, task.name))
    with cost:
        measurements: Any = evaluator.evaluate(case, cloud, rng)
    if not isinstance(measurements, Measurements):
        raise PluginError(f"the task returned {type(measurements).__name__}, not pcdbench.Measurements")
    return samples_by_metric(evaluator, measurements)


def _as_planned(plugin: Plugin) -> Any:
    """A new instance of a plugin.

    Raises:
        PcdbenchError: where its code or its weights are not those that the run's keys and configuration tell of: they
            have changed since it was planned, or are others on this machine.
    """
    planned = "that the run was planned with; give the command again, or the same files to all machines"
    if plugin.code_here() != plugin.code:
        raise PcdbenchError(f"the code of {plugin.name} is not that {planned}")
    built = plugin.build()
    if plugin.weights is not None and built.weights_digest() != plugin.weights:
        raise PcdbenchError(f"the weights of {plugin.name} are not those {planned}")
    return built


def _at(stage: Stage, work: Callable[[], T]) -> T:
    """What `work` returns; whatever it raises becomes a `Failure` of this stage."""
    try:
        return work()
    except (Failure, KeyboardInterrupt):
        raise
    except Skipped as reason:
        raise Failure("skipped", stage, str(reason)) from reason
    except PcdbenchError as error:
        raise Failure("failed", stage, str(error)) from error
    except BaseException as error:
        # Plugins may raise anything, SystemExit too; it is their cell that fails, not the run.
        lines = traceback.format_exc().splitlines()[-_TRACEBACK_LINES:]
        raise Failure("failed", stage, told(error)[:500], "\n".join(lines)) from error


def _failed_row(base: Row, cell: Cell, task: Plugin, failure: Failure) -> Row:
    return new_row(base, cell, task) | {
        "status": failure.status,
        "stage": failure.stage,
        "error": failure.error,
        "detail": failure.detail,
    }
