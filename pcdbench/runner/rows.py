"""The result row: what one task found out about one cell, as one JSON object."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pcdbench.errors import PluginError
from pcdbench.runner.plan import Cell
from pcdbench.runner.selection import Plugin
from pcdbench.threads import thread_count

if TYPE_CHECKING:
    from pcdbench.task import Measurements, Task

SCHEMA_VERSION = 1
FOREKNOWN = "foreknown"
LARGEST = 1e300  # beyond it sums of samples are infinite
"""Only in rows of completed clouds that hold points that were taken away, to the last bit: the share of those."""
Row = dict[str, Any]


def new_row(base: Mapping[str, Any], cell: Cell, task: Plugin) -> Row:
    """A row of this cell and task with nothing measured yet; `base` overrides where it says more."""
    return {
        "schema_version": SCHEMA_VERSION,
        "key": cell.row_key(task),
        "cell": cell.key,
        "scene": cell.scene,
        "draw": cell.draw,
        "incompleteness": cell.incompleteness.describe(),
        "level": cell.level,
        "seed": cell.seed,
        "completer": cell.completer.describe(),
        "task": task.describe(),
        "status": None,
        "stage": None,
        "error": None,
        "detail": None,
        "output": None,
        "metrics": {},
        "trace": {},
        "missing": None,
        "points": None,
        "completing": None,
        "evaluating": None,
        "device": None,
        **base,
    }


def cost_measured(row: Mapping[str, Any]) -> tuple[bool, str]:
    """When what completing cost was measured, to be compared: a completion from the cache measured nothing anew."""
    cost = row.get("completing") or {"cached": True}
    return not cost.get("cached"), str(row.get("time") or "")


def base_row(dataset: Plugin, cell: Cell, threads: int | None = None) -> Row:
    """What all rows of a cell say before anything is measured; `threads` is this process's share unless given."""
    part_of = {} if cell.environment in ("", cell.scene) else {"environment": cell.environment}
    return {
        "dataset": dataset.describe() | {"digest": cell.scene_digest} | part_of,
        "threads": thread_count() if threads is None else threads,
        "host": platform.node(),
        "time": utc_now(),
    }


def environment_of(row: Mapping[str, Any]) -> str:
    """What a row's scene is a part of: environments, not scenes, are independent of one another."""
    dataset = row.get("dataset")
    return str(dataset.get("environment", row["scene"])) if isinstance(dataset, Mapping) else str(row["scene"])


def utc_now() -> str:
    """The time in UTC as rows and `run.json` have it: `2022-09-01T12:00:00Z`."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def samples_by_metric(task: Task, measurements: Measurements) -> Row:
    """The measurements as the row keeps them: samples, labels and meaning by metric, and the trace.

    Raises:
        PluginError: naming the metric that is not declared, not numbers or not finite, or has no labels of its samples;
            where the main one has no samples.
    """
    import numpy as np

    for what in ("samples", "labels", "trace"):
        if not isinstance(getattr(measurements, what), Mapping):
            raise PluginError(f"the {what} must be a dict, not {type(getattr(measurements, what)).__name__}")
    declared = {metric.name: metric for metric in task.metrics}
    metrics: Row = {}
    for name, values in measurements.samples.items():
        if name not in declared:
            raise PluginError(f"the task returned {name!r}, which its `metrics` do not declare")
        try:
            samples = np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise PluginError(f"the samples of {name!r} are not numbers; give a list of float") from None
        if samples.ndim != 1:
            raise PluginError(f"the samples of {name!r} must be a sequence of numbers, not of shape {samples.shape}")
        unsound = int((~(np.abs(samples) <= LARGEST)).sum())
        if unsound:
            raise PluginError(f"{unsound} of {samples.size} samples of {name!r} are not finite, or beyond {LARGEST:g}")
        metric = declared[name]
        metrics[name] = {
            "unit": metric.unit,
            "direction": metric.direction,
            "summary": metric.summary,
            "main": metric is task.metrics[0],
            # Threads add up in any order: beyond nine digits the same cell differs from run to run.
            "samples": [float(f"{value:.9g}") for value in samples],
        }
        try:
            labels = [str(label) for label in measurements.labels.get(name, ())]
        except TypeError:
            raise PluginError(f"the labels of {name!r} must be a list with one label a sample") from None
        if labels:
            if len(labels) != samples.size:
                raise PluginError(
                    f"{name!r} has {samples.size} samples and {len(labels)} labels; give one label a sample"
                )
            metrics[name]["labels"] = labels
    main = task.metrics[0].name
    if main not in metrics or not metrics[main]["samples"]:
        # It would count as a case and have no part in the average.
        raise PluginError(f"the task returned no samples of {main!r}; raise pcdbench.Skipped where there are none")
    return {"metrics": metrics, "trace": _as_json(measurements.trace)}


def _as_json(trace: Mapping[str, Any]) -> Any:
    def plain(value: Any) -> Any:
        if hasattr(value, "tolist"):
            return value.tolist()
        raise TypeError(f"{type(value).__name__} in the trace")

    try:
        return json.loads(json.dumps(dict(trace), default=plain, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise PluginError(f"the trace must hold numbers, text and lists of them: {error}") from None
