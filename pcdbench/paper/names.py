"""Whether a publication's file names what there is: a misspelt name is a number that is missing, unexplained."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pcdbench.errors import PcdbenchError, PluginError
from pcdbench.incompleteness import MEASURED
from pcdbench.plugins import Kind, did_you_mean, registry
from pcdbench.runner.plan import ALL

if TYPE_CHECKING:
    from pcdbench.paper.publication import Experiment, Part, Publication
    from pcdbench.suite import Entry


@dataclass(frozen=True)
class _Number:
    """Where a number of a table or figure is looked up; empty for what does not decide it."""

    run: str
    level: float
    completer: str = ""
    task: str = ""
    metric: str = ""


def require_known_names(publication: Publication, path: Path) -> None:
    """Refuse names of plugins that are not installed, and numbers that the runs will not measure.

    Raises:
        PcdbenchError: naming the file, the run or part, and the names it may have meant.
    """
    for name, experiment in publication.runs.items():
        named: dict[Kind, Sequence[Entry]] = {
            "completer": experiment.completers,
            "task": experiment.tasks,
            "incompleteness": experiment.incompletenesses,
        }
        for kind, entries in named.items():
            for entry in entries:
                if entry.name != ALL:
                    try:
                        registry().get(kind, entry.name)
                    except PluginError as error:
                        raise PcdbenchError(f"{path}: the run {name}: {error}") from None
    for part in publication.parts:
        for number in _numbers(part):
            problem = _problem(number, publication.runs[number.run])
            if problem:
                raise PcdbenchError(f"{path}: {part.number}: {problem}")


def _problem(number: _Number, run: Experiment) -> str:
    """Why the run does not measure the number; empty where it does."""
    completers, tasks = _names("completer", run.completers), _names("task", run.tasks)
    if run.references:
        completers += [its.name for its in registry().all("completer") if its.reference]
    for kind, name, known in (("completer", number.completer, completers), ("task", number.task, tasks)):
        if name and name not in known:
            return f"the run {number.run} has no {kind} {name!r}; {did_you_mean(name, known)}"
    if number.level not in (*run.levels, MEASURED):
        levels = ", ".join(f"{level:g}" for level in run.levels)
        return f"the run {number.run} has no level {number.level:g}; it has {levels}"
    if number.metric and number.task:
        metrics = _metrics(number.task)
        if metrics and number.metric not in metrics:
            return f"{number.task} has no metric {number.metric!r}; {did_you_mean(number.metric, metrics)}"
    return ""


def _numbers(part: Part) -> Iterator[_Number]:
    for row in part.rows:
        yield _Number(row.run, row.level, row.completer)
        for place, column in enumerate(part.columns):
            # A gap in the published numbers may be one in the run as well.
            is_gap = bool(row.published) and math.isnan(row.published[place])
            yield _Number(row.run, row.level, row.completer, *(() if is_gap else (column.task, column.metric)))
    drawn = part.figure
    if drawn is None:
        return
    if drawn.kind == "curve":
        for point in drawn.points:
            yield _Number(point.run, drawn.level, drawn.completer, drawn.column.task, drawn.column.metric)
        return
    task, metric = (drawn.task, "") if drawn.kind == "distribution" else (drawn.column.task, drawn.column.metric)
    for level in drawn.levels:
        for completer in drawn.completers or [""]:
            yield _Number(drawn.run, level, completer, task, metric)
    for bar in drawn.published if drawn.kind == "bars" else ():
        yield _Number(drawn.run, bar.level, bar.completer)


def _names(kind: Kind, entries: Sequence[Entry]) -> list[str]:
    names = [entry.name for entry in entries]
    return [its.name for its in registry().all(kind)] if ALL in names else names


def _metrics(task: str) -> list[str]:
    """The metrics of a task; none where it cannot be loaded, which its run says with the reason."""
    try:
        return [metric.name for metric in registry().get("task", task).load().metrics]
    except (PluginError, TypeError):
        return []
