"""What every row of a run must hold for anyone to add it up: rows may come from a stranger's folder."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pcdbench.errors import PcdbenchError
from pcdbench.runner.rows import FOREKNOWN, LARGEST

_TEXTS = ("key", "cell", "scene", "status")
_STATUSES = ("ok", "failed", "timeout", "skipped")
_DIRECTIONS, _SUMMARIES = ("lower", "higher"), ("median", "mean")
_NUMBERS = frozenset((int, float))
_NAMED = ("incompleteness", "completer", "task")


def require_sound_rows(rows: Iterable[Mapping[str, Any]], path: Path) -> None:
    """Refuse rows that lack what a summary is made of, or hold another kind of value there.

    Raises:
        PcdbenchError: naming the file, the row's key and the first thing that is wrong.
    """
    for row in rows:
        problem = _problem(row)
        if problem:
            raise PcdbenchError(f"{path}: the row {str(row.get('key'))[:16]!r} has no sound {problem}; run it again")


def _problem(row: Mapping[str, Any]) -> str:
    """The first of a row's values that is missing or of another kind; "" where all are sound."""
    for name in _TEXTS:
        if not isinstance(row.get(name), str):
            return name
    if row["status"] not in _STATUSES:
        return "status"
    for name in _NAMED:
        its = row.get(name)
        if not isinstance(its, dict) or not isinstance(its.get("name"), str):
            return name
    if not isinstance(row["completer"].get("reference"), bool):
        return "completer"
    if not isinstance(row.get("draw"), int):
        return "draw"
    if not (_is_number(row.get("level")) and 0 <= row["level"] <= 1):
        return "level"
    for name in ("missing", FOREKNOWN):
        if not (row.get(name) is None or _is_number(row[name])):
            return name
    if not (row.get("error") is None or isinstance(row["error"], str)):
        return "error"
    cost = row.get("completing", "")
    if cost is not None and not (isinstance(cost, dict) and all(map(_is_cost, _costs(cost)))):
        return "completing"
    metrics = row.get("metrics")
    if not isinstance(metrics, dict):
        return "metrics"
    return next((f"metric {name[:40]!r}" for name, metric in metrics.items() if not _is_metric(metric)), "")


def _is_metric(metric: Any) -> bool:
    return (
        isinstance(metric, dict)
        and isinstance(metric.get("unit"), str)
        and metric.get("direction") in _DIRECTIONS
        and metric.get("summary") in _SUMMARIES
        and isinstance(metric.get("main"), bool)
        and isinstance(metric.get("samples"), list)
        and _are_numbers(metric["samples"])
    )


def _costs(cost: Mapping[str, Any]) -> tuple[Any, Any]:
    return cost.get("seconds", ""), cost.get("peak_memory_mb", "")


def _is_cost(value: Any) -> bool:
    return value is None or _is_number(value)


def _are_numbers(values: list[Any]) -> bool:
    # As `_is_number`, with nothing but built-in loops: a large run has millions.
    return (
        _NUMBERS.issuperset(map(type, values))
        and max(map(abs, values), default=0) <= LARGEST
        and not any(map(math.isnan, values))
    )


def _is_number(value: Any) -> bool:
    # NaN compares false, and whole numbers of JSON may be too large for a float.
    return type(value) in _NUMBERS and abs(value) <= LARGEST
