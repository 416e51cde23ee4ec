"""The contract of a task: it measures what a completed cloud is worth."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from pcdbench import options as plugin_options
from pcdbench.case import Case
from pcdbench.cloud import PointCloud

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Metric:
    """What one number means.

    Attributes:
        name: as in the result rows, with its unit where a reader could wonder (`tracking_error_m`).
        unit: for people: "m", "deg", "share", "normalised, squared".
        direction: whether lower or higher is better.
        formula: one line.
        summary: the statistic that stands for the metric where only one fits: its main figure.
    """

    name: str
    unit: str
    direction: Literal["lower", "higher"]
    formula: str
    summary: Literal["median", "mean"] = "median"


@dataclass(frozen=True)
class Measurements:
    """What a task found out about one completed cloud.

    Attributes:
        samples: by metric name: one value a case, or one value each location, step or object of it.
        labels: by metric name: what each sample belongs to (an object's label), where that means something.
        trace: what figures draw (true and estimated positions, say): lists of numbers by name; never summarised.
    """

    samples: Mapping[str, Sequence[float]]
    labels: Mapping[str, Sequence[str]] = field(default_factory=dict)
    trace: Mapping[str, Any] = field(default_factory=dict)


class Task(ABC):
    """Measures completed clouds. Subclass it, declare its metrics, write `evaluate`.

    A task never knows which completer it measures. It raises `pcdbench.Skipped(reason)` where it can say
    nothing about a case.

    Attributes:
        Options: the model of its options; `self.options` is an instance.
        version: raise it whenever values change; results of other versions are not reused.
        metrics: what it measures; the first one is the main one.
        needs_color: cells whose completed or complete cloud has no colour are skipped, with that as the reason.
        caps_density: a completed cloud with more points than the complete one is cut, by a random draw, to
            the same number before `evaluate` sees it, so that nobody wins by density.
    """

    Options: ClassVar[type[plugin_options.Options]] = plugin_options.Options
    options: plugin_options.Options
    version: ClassVar[str] = "1"
    metrics: ClassVar[tuple[Metric, ...]] = ()
    needs_color: ClassVar[bool] = False
    caps_density: ClassVar[bool] = True

    def __init__(self, options: plugin_options.Options | None = None) -> None:
        self.options = self.Options() if options is None else options

    @abstractmethod
    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        """The measurements of one completed cloud.

        Args:
            rng: the only source of randomness. It is seeded from the case and the task, not from the
                completer: every completer is measured on the same draws, so that differences can be paired.
        """

    def figures(self, rows: pd.DataFrame) -> Mapping[str, Figure]:
        """Figures of a run by file name (no extension), from this task's rows; none unless overridden.

        Args:
            rows: one row a cell, all of one incompleteness, with columns scene, draw, incompleteness, level,
                missing (the share, NaN where it is not known), completer, samples, labels, trace.
        """
        return {}
