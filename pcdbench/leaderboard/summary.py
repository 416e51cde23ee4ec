"""What rows add up to: one line a (task, metric, incompleteness, level, completer)."""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from pcdbench.incompleteness import MEASURED, UNSEEN_SHARE
from pcdbench.leaderboard.statistics import estimates
from pcdbench.runner.rows import FOREKNOWN, cost_measured, environment_of

GROUP = ["task", "metric", "incompleteness", "level", "completer"]
CASE = ["scene", "draw", "incompleteness", "level"]
STATISTICS = ("median", "p90", "mean")
_DESCRIBED = ("unit", "direction", "summary", "main")
_Cost = tuple[float | None, float | None]  # seconds, memory


def samples_table(rows: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """One line a (row, metric) that was measured.

    Columns: those of `GROUP` and `CASE`, environment, reference, missing (the share, None in rows from before it was
    kept), unit, direction, summary, main, samples (an array).
    """
    lines = []
    for row in rows:
        if row["status"] == "ok":
            task, incompleteness, level, completer = _cell(row)
            reference = row["completer"]["reference"]
            of_case = (row["scene"], environment_of(row), row["draw"], row.get("missing"))
            for name, metric in row["metrics"].items():
                described = [metric[its] for its in _DESCRIBED]
                samples = np.asarray(metric["samples"], dtype=np.float64)
                lines.append((task, name, incompleteness, level, completer, reference, *of_case, *described, samples))
    columns = [*GROUP, "reference", "scene", "environment", "draw", "missing", *_DESCRIBED, "samples"]
    return pd.DataFrame.from_records(lines, columns=columns)


def summarize(rows: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """The summary of rows, in their order of tasks, metrics and completers; levels ascend.

    Columns: those of `GROUP`; reference, unit, direction, summary, main; scenes, cases (measured), missing (the mean
    share that was missing), failed and skipped (cases without measurements; timeouts count as failed); median, p90
    and mean, each with `_low` and `_high` of its 95 % bootstrap interval over environments; seconds and memory_mb, the
    medians of completing.
    A completer of which nothing was measured has a line for its task's main metric, without numbers.
    """
    tally = _Tally()
    for row in rows:
        tally.add(row)
    return tally.summary()


def case_means(table: pd.DataFrame, completer: str) -> pd.Series:
    """The mean sample of each case of a completer, by case."""
    lines = table[(table["completer"] == completer) & (table["samples"].map(len) > 0)]
    means = lines["samples"].map(np.mean).astype(float)
    means.index = pd.MultiIndex.from_frame(lines[CASE])
    return means


def reasons(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """One line for each reason why rows have no measurements: how many, of what, why; failures first.

    Reasons that differ only in a scene's name and in numbers are one, told by its first example.
    """
    found: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["status"] != "ok":
            pattern = re.sub(r"[\d.,]+", "#", str(row["error"]).replace(row["scene"], "SCENE"))
            found.setdefault((row["status"], row["completer"]["name"], pattern), []).append(row)
    # A scene that nobody can open fails for all alike.
    alike: dict[tuple[str, str, tuple[str, ...]], list[Mapping[str, Any]]] = {}
    for (status, _, _), its in found.items():
        tasks = ", ".join(sorted({row["task"]["name"] for row in its}))
        alike.setdefault((status, tasks, tuple(sorted({row["error"] for row in its}))), []).extend(its)
    lines = []
    for (status, tasks, errors), its in sorted(alike.items(), key=lambda item: item[0][0] == "skipped"):
        completers = ", ".join(dict.fromkeys(row["completer"]["name"] for row in its))
        more = " (and alike)" if len(errors) > 1 else ""
        lines.append(f"{len(its)} {status}: {completers} on {tasks}: {its[0]['error']}{more}")
    return lines


def unseen_shares(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """One line for each incompleteness whose complete scans judge only what they saw: the share that was left out."""
    found: dict[str, dict[str, list[float]]] = {}
    tasks: dict[str, dict[str, None]] = {}
    for row in rows:
        trace = row.get("trace") if row["status"] == "ok" else None
        share = trace.get(UNSEEN_SHARE) if isinstance(trace, Mapping) else None
        if isinstance(share, int | float):
            name = row["incompleteness"]["name"]
            tasks.setdefault(name, {})[row["task"]["name"]] = None
            found.setdefault(name, {}).setdefault(row["completer"]["name"], []).append(share)
    lines = []
    for name, of_completers in found.items():
        said = [f"{its} {np.median(of):.1%} ({max(of):.1%})" for its, of in sorted(of_completers.items())]
        lines.append(
            f"{name}: in {', '.join(tasks[name])} only what the complete scan saw counts. Left out of the completed "
            f"clouds, median (most): {', '.join(said)}"
        )
    return lines


def foreknowledge(rows: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    """By completer that gave back points that were taken away, in how many of its clouds and how many; for people."""
    shares: dict[str, dict[str, float]] = {}
    for row in rows:
        if row["status"] == "ok":
            shares.setdefault(row["completer"]["name"], {})[row["cell"]] = row.get(FOREKNOWN) or 0.0
    return {
        name: f"{sum(map(bool, its.values()))} of {len(its)} completed clouds hold points that were taken away, to the "
        f"last bit (at most {max(its.values()):.0%} of them): known from elsewhere, unless the scan lies on a grid"
        for name, its in shares.items()
        if any(its.values())
    }


def level_text(level: float, missing: float = math.nan) -> str:
    """A level for people; where none was asked for, the share that was found missing: `about 62%`.

    Args:
        missing: that share, where it is known.
    """
    if level != MEASURED:
        return f"{100 * level:.3g}%"
    return "as measured" if math.isnan(missing) else f"about {missing:.0%}"


@dataclass
class _Group:
    """What was measured of one (task, metric, incompleteness, level, completer), case by case."""

    described: Mapping[str, Any]
    scenes: list[str] = field(default_factory=list)
    environments: list[str] = field(default_factory=list)
    missing: list[float] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)
    samples: array[float] = field(default_factory=lambda: array("d"))

    def add(self, scene: str, environment: str, missing: float, samples: Sequence[float]) -> None:
        # Rows of earlier versions may have none: whoever measured nothing there has no more cases for it.
        if not samples:
            return
        self.scenes.append(scene)
        self.environments.append(environment)
        self.missing.append(missing)
        self.sizes.append(len(samples))
        self.samples.extend(samples)

    def summary(self) -> dict[str, Any]:
        _, environments = np.unique(self.environments, return_inverse=True)
        missing = np.array(self.missing)
        known = missing[~np.isnan(missing)]
        columns = dict(self.described) | {
            "scenes": len(set(self.scenes)),
            "cases": len(self.scenes),
            "missing": known.mean() if known.size else np.nan,
        }
        if self.samples:
            found = estimates(np.array(self.samples), np.repeat(environments, self.sizes))
            for name, estimate in found.items():
                columns |= {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}
        return columns


class _Tally:
    """What a summary needs of rows, each looked at once and then let go: a run may have more than memory holds."""

    def __init__(self) -> None:
        self._groups: dict[tuple[str, str, str, float, str], _Group] = {}
        self._lost: dict[tuple[str, str, float, str], dict[str, int]] = {}
        self._references: dict[str, bool] = {}
        self._by_cell: dict[tuple[str, str, float, str], dict[str, _Group]] = {}
        self._costs: dict[tuple[str, float, str], dict[str, tuple[tuple[bool, str], _Cost]]] = {}

    def add(self, row: Mapping[str, Any]) -> None:
        cell = _cell(row)
        task, incompleteness, level, completer = cell
        self._references[completer] = row["completer"]["reference"]
        lost = self._lost.setdefault(cell, {"failed": 0, "skipped": 0})
        if row["status"] != "ok":
            lost["skipped" if row["status"] == "skipped" else "failed"] += 1
        cost = row["completing"]
        if cost is not None:
            costs = self._costs.setdefault((incompleteness, level, completer), {})
            measured = cost_measured(row)
            if row["cell"] not in costs or costs[row["cell"]][0] < measured:
                costs[row["cell"]] = measured, (cost["seconds"], cost["peak_memory_mb"])
        if row["status"] == "ok":
            scene, environment, missing = row["scene"], environment_of(row), row.get("missing")
            share = math.nan if missing is None else missing
            of_cell = self._by_cell.setdefault(cell, {})
            for name, metric in row["metrics"].items():
                group = of_cell.get(name)
                if group is None:
                    group = of_cell[name] = _Group({its: metric[its] for its in _DESCRIBED})
                    self._groups[task, name, incompleteness, level, completer] = group
                group.add(scene, environment, share, metric["samples"])

    def summary(self) -> pd.DataFrame:
        costs = {key: _median_cost(cost for _, cost in its.values()) for key, its in self._costs.items()}
        main: dict[str, dict[str, Any]] = {}
        records = []
        for key, group in self._groups.items():
            task, metric, incompleteness, level, completer = key
            if group.described["main"]:
                main.setdefault(task, {"metric": metric, **group.described})
            records.append(
                dict(zip(GROUP, key, strict=True))
                | {"reference": self._references[completer]}
                | group.summary()
                | self._lost[task, incompleteness, level, completer]
                | costs.get((incompleteness, level, completer), {})
            )
        for (task, incompleteness, level, completer), lost in self._lost.items():
            if not self._by_cell.get((task, incompleteness, level, completer)):
                records.append(
                    {"task": task, "incompleteness": incompleteness, "level": level, "completer": completer}
                    | {"reference": self._references[completer], "scenes": 0, "cases": 0, "missing": np.nan}
                    | main.get(task, {"metric": "", "main": True})
                    | lost
                    | costs.get((incompleteness, level, completer), {})
                )
        tasks = list(dict.fromkeys(task for task, *_ in self._lost))
        metrics = list(dict.fromkeys(metric for _, metric, *_ in self._groups))
        return _ordered(pd.DataFrame.from_records(records, columns=_columns()), tasks, metrics)


def _cell(row: Mapping[str, Any]) -> tuple[str, str, float, str]:
    return row["task"]["name"], row["incompleteness"]["name"], row["level"], row["completer"]["name"]


def _median_cost(costs: Iterable[_Cost]) -> dict[str, float]:
    """The medians of what completions cost, each (seconds, memory); NaN where nothing is known."""
    known = [[cost for cost in of_all if cost is not None] for of_all in zip(*costs, strict=True)]
    seconds, memory = (float(np.median(of_all)) if of_all else math.nan for of_all in known)
    return {"seconds": seconds, "memory_mb": memory}


def _columns() -> list[str]:
    statistics = [f"{name}{end}" for name in STATISTICS for end in ("", "_low", "_high")]
    described = ["reference", "unit", "direction", "summary", "main", "scenes", "cases", "missing", "failed", "skipped"]
    return [*GROUP, *described, *statistics, "seconds", "memory_mb"]


def _ordered(summary: pd.DataFrame, tasks: Sequence[str], metrics: Sequence[str]) -> pd.DataFrame:
    """By task and metric in these orders, incompleteness, level, references first, then completers by name."""
    rank = {name: number for number, name in enumerate(metrics)} | {"": -1}
    return summary.sort_values(
        ["task", "metric", "incompleteness", "level", "reference", "completer"],
        key=lambda column: (
            column.map(tasks.index)
            if column.name == "task"
            else column.map(rank)
            if column.name == "metric"
            else ~column.astype(bool)
            if column.name == "reference"
            else column
        ),
        kind="stable",
        ignore_index=True,
    )
