"""The numbers of a publication's tables and figures, looked up in the rows of its experiments."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pcdbench.leaderboard.statistics import Estimate
from pcdbench.leaderboard.summary import samples_table, summarize
from pcdbench.paper.experiments import Outcome
from pcdbench.paper.publication import Column

_BYTES_A_PARAMETER = 4  # as published: float32
# What batch normalisation and `Standardized` keep beside their parameters; a weights file tells them by name alone.
_BUFFERS = {"running_mean", "running_var", "num_batches_tracked", "mean", "variance", "seen"}


class Numbers:
    """What the experiments measured, by run, completer, level and column."""

    def __init__(self, outcomes: Mapping[str, Outcome]) -> None:
        self.outcomes = outcomes

    def estimate(self, run: str, completer: str, level: float, column: Column) -> Estimate | None:
        """A number in the unit of its column, with its 95 % interval; None where nothing was measured."""
        if not column.task:
            return self._cost(run, completer, level, column)
        lines = self._of(run, completer, level, column.task)
        lines = lines[lines["metric"] == column.metric]
        if lines.empty or math.isnan(lines.iloc[0][column.statistic]):
            return None
        line = lines.iloc[0]
        ends = (line[column.statistic], line[f"{column.statistic}_low"], line[f"{column.statistic}_high"])
        return Estimate(*(float(value) * column.factor for value in ends))

    def failed(self, run: str) -> int:
        """How many rows of a run failed."""
        return sum(row["status"] not in ("ok", "skipped") for row in self.outcomes[run].rows)

    def samples(self, run: str, task: str, level: float) -> Mapping[str, np.ndarray]:
        """By completer, all samples of the task's main metric."""
        table = self._samples.get(run)
        if table is None or table.empty:
            return {}
        lines = table[(table["task"] == task) & (table["level"] == level) & table["main"]]
        return {name: np.concatenate(list(its["samples"])) for name, its in lines.groupby("completer", sort=False)}

    def references(self, run: str) -> set[str]:
        """The completers of a run that are references."""
        return {row["completer"]["name"] for row in self.outcomes[run].rows if row["completer"]["reference"]}

    def metric(self, run: str, task: str) -> tuple[str, str, str]:
        """Name, unit and better direction of the main metric of a task."""
        table = self._samples[run]
        line = table[(table["task"] == task) & table["main"]].iloc[0]
        return line["metric"], line["unit"], line["direction"]

    def _of(self, run: str, completer: str, level: float, task: str) -> pd.DataFrame:
        table = self._summaries.get(run)
        if table is None or table.empty:
            return pd.DataFrame(columns=["metric"])
        return table[(table["completer"] == completer) & (table["level"] == level) & (table["task"] == task)]

    def _cost(self, run: str, completer: str, level: float, column: Column) -> Estimate | None:
        if column.metric == "parameters_mb":
            value: float | None = self._parameters_mb(run, completer)
        else:
            table = self._summaries.get(run)
            if table is None or table.empty:
                return None
            lines = table[(table["completer"] == completer) & (table["level"] == level)]
            value = None if lines.empty else float(lines.iloc[0][column.metric])
        if value is None or math.isnan(value):
            return None
        return Estimate(value * column.factor, math.nan, math.nan)

    def _parameters_mb(self, run: str, completer: str) -> float | None:
        """The size of the networks in float32, from the headers of their weights' files."""
        planned = self.outcomes[run].planned
        plugin = next((its for its in planned.completers if its.name == completer), None) if planned else None
        if plugin is None or plugin.weights is None:
            return None
        return sum(_BYTES_A_PARAMETER * _parameters(path) for path in plugin.build().weights_files()) / 1e6

    @cached_property
    def _summaries(self) -> Mapping[str, pd.DataFrame]:
        return {name: summarize(its.rows) for name, its in self.outcomes.items() if its.rows}

    @cached_property
    def _samples(self) -> Mapping[str, pd.DataFrame]:
        return {name: samples_table(its.rows) for name, its in self.outcomes.items() if its.rows}


def _parameters(weights: Path) -> int:
    """How many parameters a weights file holds, running statistics left out."""
    from safetensors import safe_open

    with safe_open(weights, "np") as stream:
        names = [name for name in stream.keys() if name.rpartition(".")[2] not in _BUFFERS]  # noqa: SIM118  no mapping
        shapes: list[Any] = [stream.get_slice(name).get_shape() for name in names]
    return sum(math.prod(shape) for shape in shapes)
