"""`README.md` of a board: what a code host shows of it."""

from __future__ import annotations

import html
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pcdbench.leaderboard.audit import CEILING, FLOOR, TRUTH
from pcdbench.leaderboard.render import escaped_markdown, estimate_text
from pcdbench.leaderboard.summary import level_text

if TYPE_CHECKING:
    from pcdbench.leaderboard.board import Board, BoardCompleter, BoardMetric, Standing

_REASONS_SHOWN = 20
_ROLES = {TRUTH: "the truth", CEILING: "the ceiling", FLOOR: "the floor"}
_READING = f"""\
Values are the metric's own statistic (its median or mean) over all samples, [with its 95 % bootstrap interval over \
scenes]. **Bold**: the best of the completers with the most cases. *Italic*: references, not methods: `{TRUTH}` is \
the complete cloud, `{CEILING}` another sample of it, the best that a method can honestly reach which makes the \
whole cloud anew, `{FLOOR}` what doing nothing scores.

\\#N is a rank: one more than the number of completers that are shown to be better, by paired differences over the \
same cases whose intervals hold for all pairs of a table at once. Completers that cannot be told apart share a rank, \
but for those with fewer cases, who come after; with fewer than six scenes nobody can. A case in which a completer \
failed counts, for its rank, with the worst value of the table; it is not in the averages, and is counted beside \
them. Seconds and MB are medians of completing a case.
"""


def board_readme(board: Board, figures: Mapping[str, Path], commands: Sequence[str], folder: Path) -> str:
    """The page in Markdown.

    Args:
        figures: by title, the files to show.
        commands: what builds this board again.
        folder: of the page; links are relative to it.
    """
    parts = [f"# {escaped_markdown(board.name)}\n", _facts(board), _overview(board), _READING, _notes(board)]
    if figures:
        shown = [
            f"### {escaped_markdown(title)}\n\n![{escaped_markdown(title)}]({path.relative_to(folder).as_posix()})\n"
            for title, path in figures.items()
        ]
        parts += ["## Figures\n", *shown]
    parts += ["## Every task\n", *_details(board), _made(board, commands)]
    return "\n".join(part for part in parts if part)


def _facts(board: Board) -> str:
    lines = []
    for number, data in enumerate(board.data):
        cases = [case for case in board.cases if case.data == number]
        ways = ", ".join(f"`{name}`" for name in sorted({case.incompleteness for case in cases}))
        lines.append(
            f"- `{data.dataset}` version {data.version}, split `{data.split}`: {len(data.scenes)} scenes, "
            f"{len(cases)} cases ({ways})"
        )
    explored = "[index.html](index.html), opened in a browser, shows every case; no network is needed."
    return "\n".join(lines) + f"\n\n{explored}\n"


def _overview(board: Board) -> str:
    """A table for each data set, incompleteness and level: a row a completer, a column a task."""
    parts = []
    for (data, incompleteness, level), standings in _tables(board).items():
        missing = next((its.missing for its in standings if not math.isnan(its.missing)), math.nan)
        title = f"{level_text(level, missing)} missing, `{incompleteness}`"
        if len(board.data) > 1:
            title = f"`{board.data[data].dataset}` {board.data[data].split}: {title}"
        parts.append(f"## {title}\n\n{_overview_table(board, standings)}")
    return "\n".join(parts)


def _overview_table(board: Board, standings: Sequence[Standing]) -> str:
    tasks = [(task.name, task.main) for task in board.tasks]
    columns = [
        (name, metric) for name, metric in tasks if metric is not None and any(its.task == name for its in standings)
    ]
    main = {name: "" if metric is None else metric.name for name, metric in tasks}
    of = {(its.completer, its.task): its for its in standings if its.metric in ("", main[its.task])}
    best = _best(board, standings)
    most = {name: max((its.cases for its in standings if its.task == name), default=0) for name, _ in columns}
    header = [""]
    for name, metric in columns:
        shown, unit = escaped_markdown(metric.name), escaped_markdown(metric.unit.split(",")[0])
        header.append(f"{name}: {metric.summary} {shown} ({unit}) {'↓' if metric.direction == 'lower' else '↑'}")
    lines = [[*header, "failed", "seconds", "MB"], [":--", *["--:"] * (len(columns) + 3)]]
    for completer in _in_order(board, standings):
        its = [of[completer.label, name] for name, _ in columns if (completer.label, name) in of]
        values = [
            _value(of.get((completer.label, name)), metric, completer, (completer.label, name) in best, most[name])
            for name, metric in columns
        ]
        failed = max((one.failed for one in its), default=0)
        costs = its[0] if its else None
        lines.append(
            [
                _name(completer),
                *values,
                str(failed) if failed else "",
                "" if completer.reference or costs is None or math.isnan(costs.seconds) else f"{costs.seconds:.2g}",
                "" if completer.reference or costs is None or math.isnan(costs.memory_mb) else f"{costs.memory_mb:.0f}",
            ]
        )
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _details(board: Board) -> list[str]:
    """For each task, a folded table of all its metrics and statistics."""
    parts = []
    metric_of = {(task.name, metric.name): metric for task in board.tasks for metric in task.metrics}
    for task in board.tasks:
        lines = [
            ["data", "missing", "completer", "metric", "median", "90th percentile", "mean", "cases"],
            [":--", "--:", ":--", ":--", "--:", "--:", "--:", "--:"],
        ]
        for its in board.standings:
            metric = metric_of.get((its.task, its.metric))
            if its.task == task.name:
                unit = metric.unit if metric else ""
                estimates = [
                    "-" if one is None else estimate_text(one, unit) for one in (its.median, its.p90, its.mean)
                ]
                lost = [
                    f"{count} {what}" for count, what in ((its.failed, "failed"), (its.skipped, "skipped")) if count
                ]
                data = board.data[its.data]
                lines.append(
                    [
                        escaped_markdown(f"{data.dataset} {data.split}, {its.incompleteness}"),
                        level_text(its.level, its.missing),
                        _name(board.completer_of[its.completer]),
                        escaped_markdown(its.metric),
                        *estimates,
                        f"{its.cases}" + (f" ({', '.join(lost)})" if lost else ""),
                    ]
                )
        table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        options = ", ".join(f"{name}={value}" for name, value in task.options.items())
        # Within a line of HTML a code host reads no Markdown, and would show its backslashes.
        summary = html.escape(
            f"{task.name}, version {task.version}" + (f" ({options})" if options else ""), quote=False
        )
        parts.append(f"<details><summary>{summary}</summary>\n\n{table}\n\n</details>\n")
    return parts


def _notes(board: Board) -> str:
    """Which completers saw the test scenes, know them or did not complete here, and why measurements are missing."""
    lines = [f"- † {_name(its)} was trained on {its.saw_test}" for its in board.completers if its.saw_test]
    lines += [f"- {_name(its)}: {its.foreknew}" for its in board.completers if its.foreknew]
    lines += [
        f"- {escaped_markdown(label)} was completed elsewhere: how, and at what cost, is not known here"
        for label in sorted(board.completed_elsewhere)
    ]
    shown = sorted(board.unmeasured().items(), key=lambda item: (item[0][0] == "skipped", -item[1], item[0]))
    lines += [
        f"- {count} {status}: {escaped_markdown(completer)} on {task}: {escaped_markdown(error)}"
        for (status, completer, task, error), count in shown[:_REASONS_SHOWN]
    ]
    if len(shown) > _REASONS_SHOWN:
        lines.append(f"- and {len(shown) - _REASONS_SHOWN} reasons more: leaderboard.json")
    return "## To be read with care\n\n" + "\n".join(lines) + "\n" if lines else ""


def _made(board: Board, commands: Sequence[str]) -> str:
    machines = sorted(
        {
            f"{run.processor}, {machine.get('cores')} cores"
            for run in board.runs
            if (machine := run.facts.get("machine", {}))
        }
    )
    commits = sorted({str((run.facts.get("git") or {}).get("commit", ""))[:10] for run in board.runs} - {""})
    told = [
        f"Measured on {'; '.join(machines)}." if machines else "",
        f"Commit {', '.join(commits)}." if commits else "",
    ]
    shown = "\n".join(f"    {command}" for command in commands)
    return f"## Made by\n\n{shown}\n\n{' '.join(filter(None, told))}\n"


def _tables(board: Board) -> Mapping[tuple[int, str, float], Sequence[Standing]]:
    found: dict[tuple[int, str, float], list[Standing]] = defaultdict(list)
    for its in board.standings:
        found[its.data, its.incompleteness, its.level].append(its)
    return found


def _in_order(board: Board, standings: Sequence[Standing]) -> list[BoardCompleter]:
    """By mean rank; references that beat every completer in the first task come before, others after."""
    ranks: dict[str, list[int]] = defaultdict(list)
    for its in standings:
        if its.rank is not None:
            ranks[its.completer].append(its.rank)
    present = [its for its in board.completers if any(one.completer == its.label for one in standings)]
    methods = sorted(
        (its for its in present if not its.reference),
        key=lambda its: (-len(ranks[its.label]), sum(ranks[its.label]), its.label),
    )
    first = next((task for task in board.tasks if any(one.task == task.name for one in standings)), None)
    metric = None if first is None else first.main
    value = {
        its.completer: _badness(its, metric)
        for its in standings
        if first is not None
        and metric is not None
        and (its.task, its.metric) == (first.name, metric.name)
        and its.mean is not None
    }
    best = min((value[its.label] for its in methods if its.label in value), default=math.inf)
    references = sorted((its for its in present if its.reference), key=lambda its: value.get(its.label, math.inf))
    above = [its for its in references if value.get(its.label, math.inf) <= best]
    return [*above, *methods, *(its for its in references if its not in above)]


def _badness(its: Standing, metric: BoardMetric) -> float:
    estimate = getattr(its, metric.summary)
    return math.inf if estimate is None else estimate.value if metric.direction == "lower" else -estimate.value


def _best(board: Board, standings: Sequence[Standing]) -> set[tuple[str, str]]:
    """(completer, task) of the best value of each task, over as many cases as any has; equals share it."""
    best = set()
    for task in board.tasks:
        metric = task.main
        its = [
            one
            for one in standings
            if metric is not None
            and (one.task, one.metric) == (task.name, metric.name)
            and one.mean is not None
            and not board.completer_of[one.completer].reference
        ]
        if metric is not None and its:
            # A mean without the cases that a completer failed on, or was not run on, is no better for it.
            most = max(one.cases for one in its)
            whole = [one for one in its if one.cases == most]
            least = min(_badness(one, metric) for one in whole)
            best |= {(one.completer, task.name) for one in whole if _badness(one, metric) == least}
    return best


def _value(its: Standing | None, metric: BoardMetric, completer: BoardCompleter, best: bool, most: int) -> str:
    if its is None or its.mean is None:
        return "-"
    text = estimate_text(getattr(its, metric.summary), metric.unit)
    value, _, interval = text.partition(" ")
    value = f"**{value}**" if best else f"*{value}*" if completer.reference else value
    fewer = f"({its.cases} of {most} cases)" if its.cases < most else ""
    return " ".join(filter(None, [value, interval, "" if its.rank is None else f"\\#{its.rank}", fewer]))


def _name(completer: BoardCompleter) -> str:
    name = escaped_markdown(completer.label)
    shown = f"*{name}*" if completer.reference else name
    role = f" ({_ROLES[completer.name]})" if completer.reference and completer.name in _ROLES else ""
    return shown + role + (" †" if completer.saw_test else "")
