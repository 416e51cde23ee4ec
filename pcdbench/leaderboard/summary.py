"""What rows add up to: one line a (task, metric, incompleteness, level, completer), and paired differences."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pcdbench.incompleteness import MEASURED
from pcdbench.leaderboard.statistics import Estimate, estimates, mean_estimate

GROUP = ["task", "metric", "incompleteness", "level", "completer"]
CASE = ["scene", "draw", "incompleteness", "level"]
STATISTICS = ("median", "p90", "mean")


def samples_table(rows: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """One line a (row, metric) that was measured.

    Columns: those of `GROUP` and `CASE`, reference, missing (the share, None in rows from before it was kept), unit,
    direction, summary, main, samples (an array).
    """
    records = [
        {
            "task": row["task"]["name"],
            "metric": name,
            "incompleteness": row["incompleteness"]["name"],
            "level": row["level"],
            "completer": row["completer"]["name"],
            "reference": row["completer"]["reference"],
            "scene": row["scene"],
            "draw": row["draw"],
            "missing": row.get("missing"),
            "unit": metric["unit"],
            "direction": metric["direction"],
            "summary": metric["summary"],
            "main": metric["main"],
            "samples": np.asarray(metric["samples"], dtype=np.float64),
        }
        for row in rows
        if row["status"] == "ok"
        for name, metric in row["metrics"].items()
    ]
    columns = [*GROUP, "reference", "scene", "draw", "missing", "unit", "direction", "summary", "main", "samples"]
    return pd.DataFrame.from_records(records, columns=columns)


def summarize(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """The summary of rows, in their order of tasks, metrics and completers; levels ascend.

    Columns: those of `GROUP`; reference, unit, direction, summary, main; scenes, cases (measured), missing (the mean
    share that was missing), failed and skipped (cases without measurements; timeouts count as failed); median, p90
    and mean, each with `_low` and `_high` of its 95 % bootstrap interval over scenes; seconds and memory_mb, the
    medians of completing.
    A completer of which nothing was measured has a line for its task's main metric, without numbers.
    """
    samples = samples_table(rows)
    counts = _counts(rows)
    costs = _costs(rows)
    records = []
    seen = set()
    for key, group in samples.groupby(GROUP, sort=False, observed=True):
        task, _, incompleteness, level, completer = key
        cell = (task, incompleteness, level, completer)
        seen.add(cell)
        first = group.iloc[0]
        records.append(
            dict(zip(GROUP, key, strict=True))
            | {name: first[name] for name in ("reference", "unit", "direction", "summary", "main")}
            | {"scenes": group["scene"].nunique(), "cases": len(group), "missing": _mean_missing(group)}
            | counts[cell]
            | _statistics(group)
            | costs.get((incompleteness, level, completer), {})
        )
    described = ["metric", "unit", "direction", "summary"]
    main = samples[samples["main"].astype(bool)].groupby("task")[described].first()
    for row in rows:
        cell = _cell(row)
        if cell not in seen:
            seen.add(cell)
            task, incompleteness, level, completer = cell
            records.append(
                {
                    "task": task,
                    "incompleteness": incompleteness,
                    "level": level,
                    "completer": completer,
                    "reference": row["completer"]["reference"],
                    "main": True,
                    "scenes": 0,
                    "cases": 0,
                    "missing": np.nan,
                }
                | (main.loc[task].to_dict() if task in main.index else {"metric": ""})
                | counts[cell]
                | costs.get((incompleteness, level, completer), {})
            )
    return _ordered(pd.DataFrame.from_records(records, columns=_columns()), rows)


def paired_difference(table: pd.DataFrame, completer: str, other: str) -> Estimate | None:
    """Mean of `completer` less that of `other`, paired by case, with its interval; None without common cases.

    Args:
        table: lines of one task and metric of `samples_table`; each case counts with its mean sample.
    """
    first, second = (case_means(table, name) for name in (completer, other))
    both = pd.concat([first, second], axis=1, join="inner").dropna()
    if both.empty:
        return None
    difference = (both.iloc[:, 0] - both.iloc[:, 1]).to_numpy()
    return mean_estimate(difference, pd.factorize(both.index.get_level_values("scene"), sort=True)[0])


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
    found: dict[tuple[bool, str, str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["status"] != "ok":
            pattern = re.sub(r"[\d.,]+", "#", str(row["error"]).replace(row["scene"], "SCENE"))
            key = (row["status"] == "skipped", row["status"], row["completer"]["name"], pattern)
            found.setdefault(key, []).append(row)
    lines = []
    for (_, status, completer, _), its in sorted(found.items(), key=lambda item: item[0][0]):
        tasks = ", ".join(sorted({row["task"]["name"] for row in its}))
        alike = len({row["error"] for row in its}) > 1
        lines.append(f"{len(its)} {status}: {completer} on {tasks}: {its[0]['error']}{' (and alike)' if alike else ''}")
    return lines


def level_text(level: float, missing: float = math.nan) -> str:
    """A level for people; where none was asked for, the share that was found missing: `about 62%`.

    Args:
        missing: that share, where it is known.
    """
    if level != MEASURED:
        return f"{level:.0%}"
    return "as measured" if math.isnan(missing) else f"about {missing:.0%}"


def _mean_missing(group: pd.DataFrame) -> float:
    return float(group["missing"].astype(float).mean())


def _statistics(group: pd.DataFrame) -> dict[str, float]:
    samples = np.concatenate(group["samples"].to_list())
    if not samples.size:
        return {}
    scenes = np.repeat(pd.factorize(group["scene"], sort=True)[0], group["samples"].map(len))
    columns: dict[str, float] = {}
    for name, estimate in estimates(samples, scenes).items():
        columns |= {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}
    return columns


def _cell(row: Mapping[str, Any]) -> tuple[str, str, float, str]:
    return row["task"]["name"], row["incompleteness"]["name"], row["level"], row["completer"]["name"]


def _counts(rows: Iterable[Mapping[str, Any]]) -> dict[tuple, dict[str, int]]:
    counts: dict[tuple, dict[str, int]] = {}
    for row in rows:
        its = counts.setdefault(_cell(row), {"failed": 0, "skipped": 0})
        if row["status"] != "ok":
            its["skipped" if row["status"] == "skipped" else "failed"] += 1
    return counts


def _costs(rows: Iterable[Mapping[str, Any]]) -> dict[tuple, dict[str, float]]:
    by_cell: dict[tuple, dict[str, Mapping[str, Any]]] = {}
    for row in rows:
        if row["completing"] is not None:
            by_cell.setdefault(_cell(row)[1:], {})[row["cell"]] = row["completing"]
    return {group: _median_cost(list(costs.values())) for group, costs in by_cell.items()}


def _median_cost(costs: Sequence[Mapping[str, float | None]]) -> dict[str, float]:
    memory = [cost["peak_memory_mb"] for cost in costs if cost["peak_memory_mb"] is not None]
    seconds = [cost["seconds"] for cost in costs if cost["seconds"] is not None]
    return {"seconds": float(np.median(seconds)), "memory_mb": float(np.median(memory)) if memory else np.nan}


def _columns() -> list[str]:
    statistics = [f"{name}{end}" for name in STATISTICS for end in ("", "_low", "_high")]
    described = ["reference", "unit", "direction", "summary", "main", "scenes", "cases", "missing", "failed", "skipped"]
    return [*GROUP, *described, *statistics, "seconds", "memory_mb"]


def _ordered(summary: pd.DataFrame, rows: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """By task, metric, incompleteness (as they first appear), level, references first, then completers by name."""
    tasks = list(dict.fromkeys(row["task"]["name"] for row in rows))
    metrics = list(dict.fromkeys(name for row in rows for name in row["metrics"]))
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
