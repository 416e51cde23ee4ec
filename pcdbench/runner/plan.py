"""Which cells a run has: every scene, draw, incompleteness, level and completer, each with its key and seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from pcdbench.errors import PcdbenchError, PluginError, told
from pcdbench.incompleteness import MEASURED
from pcdbench.keys import digest, seed_from
from pcdbench.plugins import Kind, did_you_mean, registry
from pcdbench.runner.cards import require_known_splits
from pcdbench.runner.selection import Plugin, option_targets, parse_options, select, whose_data_set

if TYPE_CHECKING:
    from pcdbench.dataset import Dataset

ALL = "all"
DEFAULT_LEVELS = (0.1, 0.3, 0.5)


@dataclass(frozen=True)
class Request:
    """What a user asked for, as typed; `plan` resolves it.

    Attributes:
        dataset: `NAME` or `NAME:PATH`.
        split: None for the data set's default.
        references: whether the registered reference completers are added.
    """

    completers: Sequence[str]
    tasks: Sequence[str]
    dataset: str = "indoor"
    split: str | None = None
    incompletenesses: Sequence[str] = ("holes",)
    levels: Sequence[float] = DEFAULT_LEVELS
    seed: int = 0
    options: Sequence[str] = ()
    references: bool = True


@dataclass(frozen=True)
class Cell:
    """One (case, completer): the unit of work that runs, fails, is stored and resumed.

    Attributes:
        dataset: identity of the data set (see `Plugin.identity`).
        scene_digest: what decides the scene's content beside that.
        draw: number of the case among those of the same scene, incompleteness and level.
        level: `MEASURED` where the incompleteness has no levels.
        environment: what the scene is a part of (see `Dataset.environment`); it decides nothing of the cloud.
    """

    dataset: str
    scene: str
    scene_digest: str
    draw: int
    incompleteness: Plugin
    level: float
    seed: int
    completer: Plugin
    environment: str = ""

    @cached_property
    def key(self) -> str:
        """Digest of all that decides the completed cloud."""
        return digest(
            [
                self.dataset,
                self.scene_digest,
                self.incompleteness.identity,
                self.level,
                self.seed,
                self.completer.identity,
            ]
        )

    @property
    def case(self) -> tuple[str, str, float, int]:
        """What tells its case from all others of the run."""
        return self.scene, self.incompleteness.identity, self.level, self.seed

    def row_key(self, task: Plugin) -> str:
        """Digest of all that decides a row's measurements: this cell's key and the task."""
        return digest([self.key, task.identity])


@dataclass(frozen=True)
class Plan:
    """The cells of a run and the tasks of each, with the configuration they came from.

    Attributes:
        environments: by scene, what it is a part of, where that is not the scene alone.
        left_out: by name, why a completer or task that `all` would have taken cannot be, or a whole plugin.
    """

    dataset: Plugin
    split: str
    tasks: tuple[Plugin, ...]
    completers: tuple[Plugin, ...]
    incompletenesses: tuple[Plugin, ...]
    levels: tuple[float, ...]
    seed: int
    scenes: Mapping[str, str]
    draws: int
    environments: Mapping[str, str] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        """All cells, those of one scene next to one another, those of one case likewise."""
        dataset = self.dataset.identity
        return tuple(
            Cell(dataset, scene, scene_digest, draw, incompleteness, level, seed, completer, environment)
            for scene, scene_digest in self.scenes.items()
            for environment in [self.environments.get(scene, scene)]
            for draw in range(self.draws)
            for incompleteness in self.incompletenesses
            for seed in [case_seed(self.seed, self.dataset.name, scene, incompleteness.name, draw)]
            for level in (self.levels if incompleteness.has_levels else (MEASURED,))
            for completer in self.completers
        )

    @cached_property
    def configuration(self) -> dict[str, Any]:
        """Everything that decides the run's rows, as JSON values."""

        def resolved(plugin: Plugin) -> dict[str, Any]:
            card = {} if plugin.card is None else {"card": dict(plugin.card)}
            return plugin.describe() | {"code": plugin.code} | card

        return {
            "dataset": resolved(self.dataset),
            "split": self.split,
            "scenes": dict(self.scenes),
            "draws": self.draws,
            "incompletenesses": [resolved(plugin) for plugin in self.incompletenesses],
            "levels": list(self.levels),
            "seed": self.seed,
            "completers": [resolved(plugin) for plugin in self.completers],
            "tasks": [resolved(plugin) for plugin in self.tasks],
        }

    @property
    def folder_name(self) -> str:
        """The name of its folder unless the user gives one: the same command finds the same folder."""
        return f"{self.dataset.name}-{self.split}-{digest(self.configuration)[:8]}"


def case_seed(seed: int, dataset: str, scene: str, incompleteness: str, draw: int) -> int:
    """The seed of a case. The level is not in it: a draw's levels are the same holes, grown."""
    return seed_from("case", seed, dataset, scene, incompleteness, draw)


def reference_names() -> list[str]:
    """The names of the reference completers that are registered."""
    return [found.name for found in registry().all("completer") if found.reference]


def plan(request: Request) -> Plan:
    """Resolve a request: names, options, levels, scenes.

    Raises:
        PcdbenchError: for whatever in it is unknown or impossible.
    """
    options = parse_options(request.options)
    dataset_name, _, dataset_path = request.dataset.partition(":")
    references = reference_names()
    completer_names = _names("completer", request.completers)
    if not request.references:
        completer_names = [name for name in completer_names if name not in references or name in request.completers]
    else:
        completer_names = [*references, *(name for name in completer_names if name not in references)]
    names: dict[Kind, Sequence[str]] = {
        "dataset": [dataset_name],
        "incompleteness": _names("incompleteness", request.incompletenesses),
        "completer": completer_names,
        "task": _names("task", request.tasks),
    }
    for kind, of_kind in names.items():
        for name in of_kind:
            registry().get(kind, name)
    option_targets(options, names)

    left_out = _out_of_reach(request)
    dataset = select("dataset", dataset_name, options.get(dataset_name, {}), path=dataset_path or None)
    with whose_data_set(dataset):
        opened = dataset.build()
        split = _split(opened, dataset_name, request.split)
    tasks = _plugins("task", names["task"], request.tasks, options, left_out)
    completers = _plugins("completer", names["completer"], request.completers, options, left_out)
    incompletenesses = _plugins("incompleteness", names["incompleteness"], request.incompletenesses, options, left_out)
    levels = _levels(request.levels)
    with whose_data_set(dataset):
        scenes, draws = _scenes(opened, dataset_name, split), _draws(opened, dataset_name, split)
        environments = {
            scene: its
            for scene in scenes
            if (its := _text(opened.environment(scene), dataset_name, "environment")) != scene
        }
    return Plan(
        dataset, split, tasks, completers, incompletenesses, levels, request.seed, scenes, draws, environments, left_out
    )


def default_split(dataset: str, options: Sequence[str], *, preferred: str) -> str:
    """The split called `preferred` where the data set has one, else its default."""
    name, _, path = dataset.partition(":")
    plugin = select("dataset", name, parse_options(options).get(name, {}), path=path or None)
    with whose_data_set(plugin):
        opened = plugin.build()
        return preferred if preferred in opened.splits() else opened.default_split


def _names(kind: Kind, asked: Sequence[str]) -> list[str]:
    """The names asked for, `all` spelt out, each once."""
    if not asked:
        raise PcdbenchError(f"no {kind} is named; name one or more, or all (see pcdbench list)")
    every = [found.name for found in registry().all(kind)] if ALL in asked else []
    return list(dict.fromkeys([*every, *(name for name in asked if name != ALL)]))


def _out_of_reach(request: Request) -> dict[str, str]:
    """Why `all` cannot take what it would have taken: names that two plugins claim, plugins that cannot be loaded."""
    asked: dict[Kind, Sequence[str]] = {
        "incompleteness": request.incompletenesses,
        "completer": request.completers,
        "task": request.tasks,
    }
    kinds = [kind for kind, names in asked.items() if ALL in names]
    found = {name: clash for kind in kinds for name, clash in registry().clashing(kind).items()}
    return found | (registry().broken if kinds else {})


def _plugins(
    kind: Kind,
    names: Sequence[str],
    asked: Sequence[str],
    options: Mapping[str, Mapping[str, str]],
    left_out: dict[str, str],
) -> tuple[Plugin, ...]:
    """The plugins; one that nobody asked for by name and that cannot be loaded is left out, with its reason."""
    found: list[Plugin] = []
    for name in names:
        try:
            plugin = select(kind, name, options.get(name, {}))
            require_known_splits(name, plugin.card)
            found.append(plugin)
        except PcdbenchError as error:
            if name in asked or name in options:
                raise
            left_out[name] = str(error)
    if not found:
        raise PcdbenchError(f"no {kind} can be used: " + "; ".join(left_out.values()))
    return tuple(found)


def _levels(levels: Sequence[float]) -> tuple[float, ...]:
    for level in levels:
        if not 0.0 < level < 1.0:
            raise PcdbenchError(f"--level {level:g} must lie between 0 and 1: it is the share of points taken away")
    if not levels:
        raise PcdbenchError("no --level is given; 0.1,0.3,0.5 are usual")
    return tuple(sorted(set(map(float, levels))))


def _split(dataset: Dataset, name: str, asked: str | None) -> str:
    splits = list(dataset.splits())
    split = dataset.default_split if asked is None else asked
    if split not in splits:
        raise PcdbenchError(f"data set {name!r} has no split {split!r}; {did_you_mean(split, splits)}")
    return split


def _scenes(dataset: Dataset, name: str, split: str) -> dict[str, str]:
    """Digest by scene; one that cannot be read keeps its place, and fails when its turn comes."""
    digests: dict[str, str] = {}
    for scene in dataset.scene_names(split):
        _text(scene, name, "scene_names")
        try:
            found = dataset.digest(scene)
        except PcdbenchError as error:
            digests[scene] = f"unreadable: {error}"
        except (Exception, SystemExit) as error:
            digests[scene] = f"unreadable: {told(error)}"
        else:
            digests[scene] = _text(found, name, "digest")
    if not digests:
        raise PcdbenchError(f"split {split!r} of data set {name!r} has no scenes; give another --split or folder")
    return digests


def _draws(dataset: Dataset, name: str, split: str) -> int:
    draws = dataset.draws(split)
    if not isinstance(draws, int) or draws < 1:
        raise PluginError(f"data set {name!r}: draws() must return a whole number from 1 on, not {draws!r:.60}")
    return draws


def _text(value: object, name: str, method: str) -> str:
    """What a data set says of a scene; rows and boards have room for a text there."""
    if not isinstance(value, str) or not value:
        raise PluginError(f"data set {name!r}: {method}() must give a text that is not empty, not {value!r:.60}")
    return value
