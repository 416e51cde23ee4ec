"""The board: what runs add up to, in one value that tables, figures, pages and the gate are made from.

A board holds what was measured (cases, and cells with their samples) and what it adds up to (standings and
comparisons), so that whatever shows it computes nothing anew. `board_file` keeps it as `leaderboard.json`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

from pcdbench.leaderboard.statistics import Estimate

Status = Literal["ok", "failed", "timeout", "skipped"]


@dataclass(frozen=True)
class BoardData:
    """A data set at one version and one of its splits.

    Attributes:
        scenes: digest of what decides a scene's content, by its name.
        environments: by scene, what it is a part of, where that is not the scene alone.
    """

    dataset: str
    version: str
    options: Mapping[str, Any]
    split: str
    scenes: Mapping[str, str]
    environments: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class BoardIncompleteness:
    """A way in which points were taken away."""

    name: str
    version: str
    options: Mapping[str, Any]


@dataclass(frozen=True)
class BoardMetric:
    """What a number of a task means; see `pcdbench.Metric`.

    Attributes:
        main: whether it is the task's first metric: the one that ranks.
    """

    name: str
    unit: str
    direction: Literal["lower", "higher"]
    summary: Literal["median", "mean"]
    main: bool

    @property
    def meaning(self) -> str:
        """What must be the same for values of two runs to stand beside one another, for messages."""
        return metric_meaning(self.direction, self.summary, self.main)


def metric_meaning(direction: str, summary: str, main: bool) -> str:
    """See `BoardMetric.meaning`."""
    return f"{'the main' if main else 'a'} metric, {direction} is better, by its {summary}"


@dataclass(frozen=True)
class BoardTask:
    """A task as it was measured; its main metric is the first."""

    name: str
    version: str
    options: Mapping[str, Any]
    metrics: tuple[BoardMetric, ...]

    @property
    def main(self) -> BoardMetric | None:
        """The metric that ranks; None where nothing was measured."""
        return next((metric for metric in self.metrics if metric.main), None)


@dataclass(frozen=True)
class BoardCompleter:
    """A completer with one set of options and weights.

    Attributes:
        label: what the board calls it, no two alike: its name, and what differs where the name is there twice.
        reference: a row to measure against, never ranked.
        weights: digest of its weights, or None.
        card: its model card, or None.
        saw_test: why it is flagged: which of the board's test scenes its card says it was trained on; empty
            where it is not.
        foreknew: in how many of its clouds are points that were taken away, to the last bit; empty where in none.
    """

    label: str
    name: str
    version: str
    options: Mapping[str, Any]
    reference: bool
    weights: str | None = None
    card: Mapping[str, Any] | None = None
    saw_test: str = ""
    foreknew: str = ""


@dataclass(frozen=True)
class BoardCase:
    """A scene made incomplete.

    Attributes:
        data: index into `Board.data`.
        level: the share asked for, 0 for pairs whose share is measured.
        draw: number among the cases of this scene, incompleteness, level and seed.
        seed: the seed of the run, as `pcdbench run --seed` takes it.
        missing: the share that was missing, where it is known.
    """

    data: int
    scene: str
    incompleteness: str
    level: float
    draw: int
    seed: int
    missing: float | None


@dataclass(frozen=True)
class BoardResult:
    """What a task found out about a cell.

    Attributes:
        key: the first 16 digits of the key of its row in `rows.jsonl`.
        error: why there is nothing measured.
        values: by metric, the mean of the case's samples; metrics without samples are left out.
        samples: all samples of the main metric.
    """

    key: str
    status: Status
    error: str | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    samples: tuple[float, ...] = ()


@dataclass(frozen=True)
class BoardCell:
    """One (case, completer) with its tasks.

    Attributes:
        case: index into `Board.cases`.
        completer: label.
        key: the first 16 digits of the cell's key.
        run: index into `Board.runs`: where its cost was measured.
        seconds, memory_mb: what completing cost; None where it never came to that, or is not known.
        results: by task.
        cached: whether the completion was taken from the cache: its cost was measured some time before its run.
    """

    case: int
    completer: str
    key: str
    run: int
    seconds: float | None
    memory_mb: float | None
    results: Mapping[str, BoardResult]
    cached: bool = False


@dataclass(frozen=True)
class BoardRun:
    """Where rows came from.

    Attributes:
        facts: of `run.json`: time, git, machine, packages, workers.
        calibration_seconds: time of the calibration job on that machine; None in runs from before it was measured.
    """

    facts: Mapping[str, Any]
    calibration_seconds: float | None

    @property
    def processor(self) -> str:
        """The name of the machine's processor, as it gives it."""
        return str(self.facts.get("machine", {}).get("cpu") or "an unknown processor")


@dataclass(frozen=True)
class Standing:
    """A completer's figures in one table: one (data, incompleteness, level, task, metric).

    Attributes:
        scenes, cases: how many were measured.
        failed: failed and timed-out cases.
        skipped: cases in which there was nothing to measure.
        missing: mean share that was missing, NaN where it is not known.
        median, p90, mean: over all samples, each with its 95 % interval; None where nothing was measured.
        rank: 1 + the number of completers shown to be better (see `ranks`); None for references, for metrics that
            are not the task's main one, and where nothing was measured.
        seconds, memory_mb: medians of completing, NaN where they are not known.
    """

    data: int
    incompleteness: str
    level: float
    task: str
    metric: str
    completer: str
    scenes: int
    cases: int
    failed: int
    skipped: int
    missing: float
    median: Estimate | None
    p90: Estimate | None
    mean: Estimate | None
    rank: int | None
    seconds: float
    memory_mb: float


@dataclass(frozen=True)
class Comparison:
    """A paired difference of two completers in one table, by its main metric.

    Attributes:
        difference: the metric's own statistic (median or mean) of `first` less that of `second`, over the same
            cases, with its simultaneous 95 % interval over all pairs of the table.
        cases: how many both were tried on.
        better: the label of the one shown to be better, or None.
    """

    data: int
    incompleteness: str
    level: float
    task: str
    first: str
    second: str
    difference: Estimate
    cases: int
    better: str | None


@dataclass(frozen=True)
class Board:
    """A leaderboard. Everything in it is sorted, so that equal runs give an equal board in whatever order they came.

    Attributes:
        completers: references first, then by label.
        standings: by data, incompleteness, level, task, metric (the main one first), then in the order of `completers`.
    """

    name: str
    data: tuple[BoardData, ...]
    incompletenesses: tuple[BoardIncompleteness, ...]
    tasks: tuple[BoardTask, ...]
    completers: tuple[BoardCompleter, ...]
    runs: tuple[BoardRun, ...]
    cases: tuple[BoardCase, ...]
    cells: tuple[BoardCell, ...]
    standings: tuple[Standing, ...]
    comparisons: tuple[Comparison, ...]

    @cached_property
    def completer_of(self) -> Mapping[str, BoardCompleter]:
        """Completers by label."""
        return {completer.label: completer for completer in self.completers}

    @cached_property
    def task_of(self) -> Mapping[str, BoardTask]:
        """Tasks by name."""
        return {task.name: task for task in self.tasks}

    @cached_property
    def completed_elsewhere(self) -> frozenset[str]:
        """The labels of completers whose clouds were handed to the runs: what completing cost is known of none."""
        measured = [cell for cell in self.cells if any(its.status == "ok" for its in cell.results.values())]
        known = {cell.completer for cell in measured if cell.seconds is not None}
        return frozenset(cell.completer for cell in measured if not self.completer_of[cell.completer].reference) - known

    def unmeasured(self) -> Counter[tuple[Status, str, str, str]]:
        """How many results have no measurements, by (status, completer, task, reason)."""
        return Counter(
            (result.status, cell.completer, task, result.error or "")
            for cell in self.cells
            for task, result in cell.results.items()
            if result.status != "ok"
        )
