"""The gate: what of a committed board got worse, better, slower or is measured otherwise, in a fresh board.

Both have the same cases, so everything is paired by case. Equal keys have equal results: what nobody touched differs
by nothing at all, and only what changed is tested.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import ttest_1samp

from pcdbench.errors import PcdbenchError
from pcdbench.keys import canonical_json
from pcdbench.leaderboard.board import Board, BoardCase, BoardCell, BoardCompleter
from pcdbench.leaderboard.merging import AGREEMENT, version_text
from pcdbench.leaderboard.summary import level_text

FEWEST_CASES = 4
SIGNIFICANCE = 0.01
"""How often a change that changes nothing may be called better or worse, over all that a check compares."""
LEAST_CHANGE = 1e-3
"""Smaller mean changes, as shares of the metric's mean, are no regression however certain they are."""
SLOWER = 2.0
SLOWER_ELSEWHERE = 6.0
"""Twice the largest ratio found between two processors for a completer that nobody had changed: the calibration job
does not show how much faster a processor multiplies matrices in bfloat16 than it does all else."""
_SHORTEST_SECONDS = 0.002
_SAME = 1e-9

Kind = Literal["worse", "failed", "changed", "slower", "better", "repaired", "faster", "note"]
REGRESSIONS: tuple[Kind, ...] = ("worse", "failed", "changed", "slower")


@dataclass(frozen=True)
class Finding:
    """Something that differs from the committed board.

    Attributes:
        task: empty where it concerns a completer's time, or the whole board.
        told: one line, for people.
    """

    kind: Kind
    completer: str
    task: str
    told: str

    @property
    def is_regression(self) -> bool:
        return self.kind in REGRESSIONS


@dataclass(frozen=True)
class Verdict:
    """What a check found.

    Attributes:
        cases: how many both boards have.
        compared: each (completer, task) that was, in the order of the committed board.
        findings: regressions first.
    """

    board: str
    cases: int
    compared: tuple[tuple[str, str], ...]
    findings: tuple[Finding, ...]

    @property
    def holds(self) -> bool:
        """Whether there is no regression."""
        return not any(finding.is_regression for finding in self.findings)


_Groups = dict[Hashable, list[BoardCompleter]]


@dataclass(frozen=True)
class _Pair:
    case: BoardCase
    old: BoardCell
    new: BoardCell


def check(committed: Board, fresh: Board) -> Verdict:
    """Compare a fresh board of some of the committed board's cases with it.

    - A protocol (data, incompleteness, task) that is another, and a reference whose values differ, is `changed`: the
      numbers of the two boards do not mean the same.
    - A completer's metric is `worse` (or `better`) where the mean of its relative differences on a data set, paired by
      case, is beyond `LEAST_CHANGE` and one-sided t-tests, by Holm's method over everything that changed, are at half
      of `SIGNIFICANCE` each.
    - A case that was measured and is not any more is `failed`, and so is a metric that has no value of it any more.
    - A completer is `slower` where the median of its cases' times, as ratios to the calibration job of the same run,
      is `SLOWER` times what it was; `SLOWER_ELSEWHERE` times where another processor measured the board.

    Raises:
        PcdbenchError: where both have too few cases, or none of the board's methods, in common.
    """
    changed = list(changed_protocols(committed, fresh))
    pairs = paired(committed, fresh)
    cases = {pair.case for its in pairs.values() for pair in its}
    if len(cases) < FEWEST_CASES and not changed:
        raise PcdbenchError(
            f"the run has {len(cases)} cases of the board {committed.name}, and a check needs {FEWEST_CASES}; run more "
            "scenes or levels of the same data set, split and seed"
        )
    methods = [its.label for its in committed.completers if not its.reference]
    if methods and not changed and not any(pairs.get(label) for label in methods):
        raise PcdbenchError(
            f"the run has none of the completers of the board {committed.name} ({', '.join(methods[:8])}); run one of "
            "them"
        )
    altered = {finding.task for finding in changed}
    findings = [*changed, *_unmatched(committed, fresh)]
    if "" not in altered:
        findings += _lost(pairs, altered)
        findings += reference_changes(committed, pairs, altered)
        altered |= {finding.task for finding in findings if finding.kind == "changed"}
        findings += _lost_values(committed, pairs, altered)
        findings += _value_changes(committed, pairs, altered)
        findings += _time_changes(committed, fresh, pairs)
    compared = [
        (label, task.name) for label, its in pairs.items() for task in committed.tasks if _has_task(its, task.name)
    ]
    order = sorted(findings, key=lambda finding: not finding.is_regression)
    return Verdict(committed.name, len(cases), tuple(compared), tuple(order))


def changed_protocols(committed: Board, fresh: Board) -> Iterator[Finding]:
    """What of the protocols is another; with an empty task where nothing can be compared."""
    for kind, olds, news in (
        ("data set", {its.dataset: its for its in committed.data}, {its.dataset: its for its in fresh.data}),
        (
            "incompleteness",
            {its.name: its for its in committed.incompletenesses},
            {its.name: its for its in fresh.incompletenesses},
        ),
        ("task", committed.task_of, fresh.task_of),
    ):
        for name, old in olds.items():
            new = news.get(name)
            if new is None:
                continue
            is_now, was = (version_text(its.version, its.options) for its in (new, old))
            if is_now != was:
                told = f"{kind} {name} is {is_now}, the board's is {was}; build the board again"
                yield Finding("changed", "", name if kind == "task" else "", told)
    for task in committed.tasks:
        fresh_task = fresh.task_of.get(task.name)
        means_now = {} if fresh_task is None else {its.name: its for its in fresh_task.metrics}
        moved = next((its for its in task.metrics if means_now.get(its.name, its).meaning != its.meaning), None)
        if moved is not None:
            told = (
                f"{moved.name} of task {task.name} is {means_now[moved.name].meaning}, the board's is "
                f"{moved.meaning}; raise the task's version, and build the board again"
            )
            yield Finding("changed", "", task.name, told)
    digests = {(its.dataset, scene): digest for its in committed.data for scene, digest in its.scenes.items()}
    for data in fresh.data:
        other = [name for name, digest in data.scenes.items() if digests.get((data.dataset, name), digest) != digest]
        if other:
            told = f"{len(other)} scenes of {data.dataset} have other content than the board's: {other[0]} is the first"
            yield Finding("changed", "", "", told)


def paired(committed: Board, fresh: Board) -> dict[str, list[_Pair]]:
    """By the committed board's label, the cells that both have."""
    label_of = {new.label: old.label for old, new in _matched(committed, fresh) if new is not None}
    found: dict[str, list[_Pair]] = {its.label: [] for its in committed.completers if its.label in label_of.values()}
    old_cells = {(case_key(committed, committed.cases[cell.case]), cell.completer): cell for cell in committed.cells}
    for cell in fresh.cells:
        label = label_of.get(cell.completer, "")
        old = old_cells.get((case_key(fresh, fresh.cases[cell.case]), label))
        if old is not None:
            found[label].append(_Pair(committed.cases[old.case], old, cell))
    return found


def _matched(committed: Board, fresh: Board) -> list[tuple[BoardCompleter, BoardCompleter | None]]:
    """Each completer of the committed board and the fresh one that it is compared with, which no other is.

    That is the only one of its name, else the one of its options, version and weights, else that of its options and
    version, else that of its options. Of several versions on the board the one that was measured last stands for them.
    """
    new_of: dict[str, BoardCompleter] = {}
    measured = _last_measured(committed)
    news_named = _grouped(fresh.completers, _name)
    for name, olds in _grouped(committed.completers, _name).items():
        if len(olds) == len(news_named[name]) == 1:
            new_of[olds[0].label] = news_named[name][0]
    for same in (_release, _version, _entry):
        taken = {its.label for its in new_of.values()}
        news_alike = _grouped((its for its in fresh.completers if its.label not in taken), same)
        for key, olds in _grouped((its for its in committed.completers if its.label not in new_of), same).items():
            if len(news_alike[key]) == 1:
                new_of[max(olds, key=lambda old: measured.get(old.label, "")).label] = news_alike[key][0]
    return [(old, new_of.get(old.label)) for old in committed.completers]


def _name(its: BoardCompleter) -> str:
    return its.name


def _entry(its: BoardCompleter) -> tuple[str | None, ...]:
    return its.name, canonical_json(its.options)


def _version(its: BoardCompleter) -> tuple[str | None, ...]:
    return *_entry(its), its.version


def _release(its: BoardCompleter) -> tuple[str | None, ...]:
    return *_version(its), its.weights


def _grouped(completers: Iterable[BoardCompleter], same: Callable[[BoardCompleter], Hashable]) -> _Groups:
    groups: _Groups = defaultdict(list)
    for its in completers:
        groups[same(its)].append(its)
    return groups


def _last_measured(board: Board) -> dict[str, str]:
    """By label, when the latest run that has cells of it began."""
    latest: dict[str, str] = {}
    for cell in board.cells:
        time = str(board.runs[cell.run].facts.get("time") or "")
        latest[cell.completer] = max(time, latest.get(cell.completer, ""))
    return latest


def case_key(board: Board, case: BoardCase) -> tuple:
    """What makes a case of one board that of another."""
    data = board.data[case.data]
    return data.dataset, data.split, case.scene, case.incompleteness, case.level, case.draw, case.seed


def _unmatched(committed: Board, fresh: Board) -> Iterator[Finding]:
    matched = _matched(committed, fresh)
    for old, new in matched:
        if new is None:
            yield Finding("note", old.label, "", f"{old.label} is on the board and was not run")
        elif canonical_json(new.options) != canonical_json(old.options):
            yield Finding("note", old.label, "", f"{old.label} was run with other options than the board's")
    tables = _tables(committed)
    not_run = sorted(tables - _tables(fresh))
    if not_run:
        dataset, split, incompleteness, level, task = not_run[0]
        told = f"{len(not_run)} of the board's {len(tables)} tables were not run, {task} of {dataset} {split} "
        yield Finding("note", "", "", f"{told}({incompleteness}, {level_text(level)}) for one")
    known = {new.label for _, new in matched if new is not None}
    for its in fresh.completers:
        if its.label not in known:
            yield Finding("note", its.label, "", f"{its.label} is not on the board")


def _tables(board: Board) -> set[tuple[str, str, str, float, str]]:
    """What a board has cases of: data set, split, incompleteness, level and task."""
    return {
        (data.dataset, data.split, case.incompleteness, case.level, task)
        for cell in board.cells
        for case in [board.cases[cell.case]]
        for data in [board.data[case.data]]
        for task in cell.results
    }


def _lost(pairs: Mapping[str, Sequence[_Pair]], altered: set[str]) -> Iterator[Finding]:
    """Cases that were measured and are not any more, and the other way round."""
    for label, its in pairs.items():
        for task in sorted({task for pair in its for task in pair.old.results} - altered):
            both = [(pair, pair.old.results[task], pair.new.results[task]) for pair in its if _both(pair, task)]
            lost = [(pair, new) for pair, old, new in both if old.status == "ok" != new.status]
            if lost:
                pair, new = lost[0]
                told = (
                    f"{task} of {label}: {len(lost)} of {len(both)} cases {new.status}: {pair.case.scene}: {new.error}"
                )
                yield Finding("failed", label, task, told)
            found = sum(new.status == "ok" != old.status for _, old, new in both)
            if found:
                yield Finding("repaired", label, task, f"{task} of {label}: {found} cases are measured that were not")


def _lost_values(committed: Board, pairs: Mapping[str, Sequence[_Pair]], altered: set[str]) -> Iterator[Finding]:
    """Metrics of completers that have no value any more in cases that their task still measures."""
    for label, its in pairs.items():
        if committed.completer_of[label].reference:
            continue
        for task in committed.tasks:
            for metric in task.metrics if task.name not in altered else ():
                lost = _without_value(its, task.name, metric.name)
                if lost:
                    count = len(lost) + len(_both_values(its, task.name, metric.name))
                    told = (
                        f"{metric.name} ({task.name}) of {label}: {len(lost)} of {count} cases have no value any more: "
                        f"{lost[0].scene} is the first"
                    )
                    yield Finding("failed", label, task.name, told)


def reference_changes(committed: Board, pairs: Mapping[str, Sequence[_Pair]], altered: set[str]) -> Iterator[Finding]:
    """References do nothing that could get better or worse: where their values differ, what measures them does.

    A few cases that differ may be another machine's rounding, which registration can make large, and are a note: fewer
    than half of all, of each data set and of each table; sets and tables of very few cases count with the others.
    """
    for label, its in pairs.items():
        if not committed.completer_of[label].reference:
            continue
        for task in committed.tasks:
            if task.name in altered:
                continue
            for metric in task.metrics:
                both = _both_values(its, task.name, metric.name)
                lost = _without_value(its, task.name, metric.name)
                other = [(case, not np.isclose(old, new, rtol=AGREEMENT, atol=_SAME)) for case, old, new in both]
                other += [(case, True) for case in lost]
                if any(differs for _, differs in other):
                    where = f"differs in {sum(differs for _, differs in other)} of {len(other)} cases"
                    where += f" ({len(lost)} have no value any more)" if lost else ""
                    told = f"{metric.name} ({task.name}) of the reference {label} {where}"
                    if not _differ_somewhere(other):
                        yield Finding(
                            "note", label, task.name, f"{told}: another machine's rounding, or a small change"
                        )
                        continue
                    cure = "what is measured has changed; raise the version of what did, and build the board again"
                    yield Finding("changed", label, task.name, f"{told}: {cure}")


def _differ_somewhere(other: Sequence[tuple[BoardCase, bool]]) -> bool:
    """Whether half of the cases or more differ: of all, of a data set or of a table, if these have cases enough."""
    parts: dict[tuple[Any, ...], list[bool]] = defaultdict(list)
    for case, differs in other:
        for part in ((), (case.data,), (case.data, case.incompleteness, case.level)):
            parts[part].append(differs)
    return any(2 * sum(its) >= len(its) for part, its in parts.items() if not part or len(its) >= FEWEST_CASES)


def _value_changes(committed: Board, pairs: Mapping[str, Sequence[_Pair]], altered: set[str]) -> Iterator[Finding]:
    """Metrics of completers that got worse or better on a data set: what another one gained must not hide that."""
    tests = []
    for label, where, its in _by_data(committed, pairs):
        if len(its) < FEWEST_CASES:
            told = f"metrics of {label}{where} were not compared: {len(its)} cases, and {FEWEST_CASES} are needed"
            yield Finding("note", label, "", told)
            continue
        for task in committed.tasks:
            if task.name in altered:
                continue
            for metric in task.metrics:
                relative, scale = _relative_differences(its, task.name, metric.name)
                if len(relative) >= FEWEST_CASES and np.abs(relative).max() > _SAME:
                    worse = relative if metric.direction == "lower" else -relative
                    tests.append((label, where, task.name, metric.name, worse, scale))
    p_values = [min(_p_value(worse), _p_value(-worse)) for *_, worse, _ in tests]
    for number in _rejected_by_holm(p_values):
        label, where, task_name, name, worse, scale = tests[number]
        mean = float(worse.mean())
        if abs(mean) > LEAST_CHANGE:
            kind: Kind = "worse" if mean > 0 else "better"
            told = (
                f"{name} ({task_name}) of {label}{where}: {kind} by {abs(mean):.2%} of its mean ({scale:.4g}) over "
                f"{len(worse)} cases, in {int((worse > 0).sum() if mean > 0 else (worse < 0).sum())} of them"
            )
            yield Finding(kind, label, task_name, told)


def _by_data(committed: Board, pairs: Mapping[str, Sequence[_Pair]]) -> Iterator[tuple[str, str, Sequence[_Pair]]]:
    """Each completer that is no reference with its pairs on one data set, and which that is where there are several."""
    for label, its in pairs.items():
        if not committed.completer_of[label].reference:
            for number, data in enumerate(committed.data):
                of_data = [pair for pair in its if pair.case.data == number]
                if of_data:
                    yield label, f" on {data.dataset} {data.split}" if len(committed.data) > 1 else "", of_data


def _relative_differences(pairs: Sequence[_Pair], task: str, metric: str) -> tuple[NDArray[np.float64], float]:
    """(n,) new less old of each case, as a share of the mean of its incompleteness and level; and the overall mean.

    Args:
        pairs: of one data set.
    """
    by_table: dict[tuple[str, float], list[tuple[float, float]]] = defaultdict(list)
    for case, old, new in _both_values(pairs, task, metric):
        by_table[case.incompleteness, case.level].append((old, new))
    relative, means = [np.empty(0)], []
    for its in by_table.values():
        values = np.array(its)
        scale = float(np.abs(values[:, 0]).mean())
        means.append(scale)
        relative.append((values[:, 1] - values[:, 0]) / (scale or 1.0))
    return np.concatenate(relative), float(np.mean(means)) if means else 0.0


def _both_values(pairs: Sequence[_Pair], task: str, metric: str) -> list[tuple[BoardCase, float, float]]:
    """Each case that both boards have a value of, with the old and the new one."""
    found = []
    for pair in pairs:
        if _both(pair, task):
            old, new = (cell.results[task].values.get(metric) for cell in (pair.old, pair.new))
            if old is not None and new is not None:
                found.append((pair.case, old, new))
    return found


def _without_value(pairs: Sequence[_Pair], task: str, metric: str) -> list[BoardCase]:
    """Each case that the task measured both times, and of which only the old board has a value of the metric."""
    return [
        pair.case
        for pair in pairs
        if _both(pair, task)
        and pair.new.results[task].status == "ok"
        and metric in pair.old.results[task].values
        and metric not in pair.new.results[task].values
    ]


def _p_value(worse: NDArray[np.float64]) -> float:
    """That of a one-sided t-test for a mean above 0."""
    if np.ptp(worse) == 0:
        return 0.0 if worse[0] > 0 else 1.0
    return float(ttest_1samp(worse, 0.0, alternative="greater").pvalue)


def _rejected_by_holm(p_values: Sequence[float]) -> list[int]:
    """Which hypotheses fall; half the significance for each side, since either may be asked about."""
    rejected = []
    for rank, number in enumerate(np.argsort(p_values, kind="stable")):
        if p_values[number] > SIGNIFICANCE / 2 / (len(p_values) - rank):
            break
        rejected.append(int(number))
    return sorted(rejected)


def _time_changes(committed: Board, fresh: Board, pairs: Mapping[str, Sequence[_Pair]]) -> Iterator[Finding]:
    """Completers that take longer, or shorter, as ratios to the calibration jobs."""
    for label, its in pairs.items():
        if committed.completer_of[label].reference:
            continue
        ratios, elsewhere = [], set[str]()
        for pair in its:
            old = _calibrated(committed, pair.old)
            new = _calibrated(fresh, pair.new)
            if old and new and max(pair.old.seconds or 0, pair.new.seconds or 0) >= _SHORTEST_SECONDS:
                ratios.append(new / old)
                was, now = committed.runs[pair.old.run].processor, fresh.runs[pair.new.run].processor
                if was != now:
                    elsewhere.add(f"{was}; here: {now}")
        if len(ratios) >= FEWEST_CASES:
            ratio = float(np.median(ratios))
            told = f"{label} takes {ratio:.2g} times its time on the board, calibrated (median of {len(ratios)} cases)"
            limit = SLOWER
            if elsewhere:
                limit = SLOWER_ELSEWHERE
                told += f", measured by another processor ({', '.join(sorted(elsewhere))})"
            if ratio >= limit:
                yield Finding("slower", label, "", told)
            elif ratio >= SLOWER:
                yield Finding("note", label, "", f"{told}: no regression below {limit:g} times")
            elif ratio <= 1 / limit:
                yield Finding("faster", label, "", told)
        elif its:
            yield Finding("note", label, "", f"{label} has no times to compare")


def _calibrated(board: Board, cell: BoardCell) -> float | None:
    """Seconds as a multiple of the calibration job of the run that measured them; None where that is not known."""
    calibration = None if cell.cached else board.runs[cell.run].calibration_seconds
    return cell.seconds / calibration if cell.seconds and calibration else None


def _both(pair: _Pair, task: str) -> bool:
    return task in pair.old.results and task in pair.new.results


def _has_task(pairs: Sequence[_Pair], task: str) -> bool:
    return any(_both(pair, task) for pair in pairs)
