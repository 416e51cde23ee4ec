"""A board from runs."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pcdbench.keys import canonical_json, digest
from pcdbench.leaderboard.board import (
    Board,
    BoardCase,
    BoardCell,
    BoardCompleter,
    BoardData,
    BoardIncompleteness,
    BoardMetric,
    BoardResult,
    BoardRun,
    BoardTask,
    Comparison,
    Standing,
)
from pcdbench.leaderboard.merging import MergedRow, RunRows, merge, read_runs
from pcdbench.leaderboard.ranks import Ranking, Tried, ranking
from pcdbench.leaderboard.saw_test import seen_in_training
from pcdbench.leaderboard.statistics import Estimate
from pcdbench.leaderboard.summary import foreknowledge, summarize
from pcdbench.runner.rows import cost_measured, environment_of

KEY_DIGITS = 16
_FACTS = ("time", "git", "machine", "packages", "workers")

Table = tuple[int, str, float, str]


def board_of_runs(name: str, folders: Iterable[Path]) -> Board:
    """The board that the runs in these folders add up to.

    Raises:
        PcdbenchError: where a folder holds no run, or runs do not fit together (see `merging.merge`).
    """
    runs = read_runs(folders)
    return board_of_rows(name, runs, merge(runs))


def board_of_rows(name: str, runs: Sequence[RunRows], merged: Sequence[MergedRow]) -> Board:
    """The board that merged rows add up to; `MergedRow.run` counts in `runs`."""
    splits = [str(run.configuration["split"]) for run in runs]
    data = _data(merged, splits)
    tasks = _tasks(merged)
    completers = _completers(runs, merged, data)
    label_of = _labels(completers, merged)
    number_of = {(its.dataset, its.split): number for number, its in enumerate(data)}

    def place(one: MergedRow) -> tuple[int, str, float]:
        row = one.row
        return number_of[row["dataset"]["name"], splits[one.run]], row["incompleteness"]["name"], row["level"]

    cases: dict[tuple, BoardCase] = {}
    by_cell: dict[tuple, list[MergedRow]] = defaultdict(list)
    for one in merged:
        row = one.row
        of, incompleteness, level = place(one)
        seed = int(runs[one.run].configuration.get("seed", 0))
        case = (of, incompleteness, level, row["scene"], row["draw"], seed)
        found = cases.get(case)
        if found is None or found.missing is None:
            missing = row.get("missing")
            cases[case] = BoardCase(of, row["scene"], incompleteness, level, row["draw"], seed, missing)
        by_cell[case, label_of[id(row["completer"])]].append(one)
    order = sorted(cases)
    case_number = {case: number for number, case in enumerate(order)}
    position = {its.label: number for number, its in enumerate(completers)}
    cells = [
        _cell(case_number[case], label, its)
        for (case, label), its in sorted(by_cell.items(), key=lambda item: (item[0][0], position[item[0][1]]))
    ]
    ordered_cases = [cases[case] for case in order]
    rankings = rankings_of(data, ordered_cases, cells, completers, tasks)
    labelled: dict[int, list[Mapping[str, Any]]] = defaultdict(list)
    for one in merged:
        completer = one.row["completer"] | {"name": label_of[id(one.row["completer"])]}
        labelled[place(one)[0]].append({**one.row, "completer": completer})
    standings = [
        standing
        for number in sorted(labelled)
        for standing in _standings(number, labelled[number], rankings, completers, tasks)
    ]
    foreknown = foreknowledge(row for rows in labelled.values() for row in rows)
    return Board(
        name=name,
        data=data,
        incompletenesses=_incompletenesses(merged),
        tasks=tasks,
        completers=tuple(replace(its, foreknew=foreknown.get(its.label, "")) for its in completers),
        runs=tuple(_run(run) for run in runs),
        cases=tuple(ordered_cases),
        cells=tuple(cells),
        standings=tuple(standings),
        comparisons=comparisons_of(rankings),
    )


def _data(merged: Sequence[MergedRow], splits: Sequence[str]) -> tuple[BoardData, ...]:
    scenes: dict[tuple[str, str], dict[str, str]] = defaultdict(dict)
    environments: dict[tuple[str, str], dict[str, str]] = defaultdict(dict)
    described: dict[str, Mapping[str, Any]] = {}
    for one in merged:
        dataset = one.row["dataset"]
        described[dataset["name"]] = dataset
        of, scene, environment = (dataset["name"], splits[one.run]), one.row["scene"], environment_of(one.row)
        scenes[of][scene] = dataset["digest"]
        if environment != scene:
            environments[of][scene] = environment
    return tuple(
        BoardData(
            name,
            described[name]["version"],
            described[name]["options"],
            split,
            dict(sorted(its.items())),
            dict(sorted(environments[name, split].items())),
        )
        for (name, split), its in sorted(scenes.items())
    )


def _incompletenesses(merged: Sequence[MergedRow]) -> tuple[BoardIncompleteness, ...]:
    found = {one.row["incompleteness"]["name"]: one.row["incompleteness"] for one in merged}
    return tuple(BoardIncompleteness(name, its["version"], its["options"]) for name, its in sorted(found.items()))


def _tasks(merged: Sequence[MergedRow]) -> tuple[BoardTask, ...]:
    found: dict[str, Mapping[str, Any]] = {}
    metrics: dict[str, dict[str, BoardMetric]] = defaultdict(dict)
    for one in merged:
        task = one.row["task"]
        found[task["name"]] = task
        of_task = metrics[task["name"]]
        for name, its in one.row["metrics"].items():
            if name not in of_task:
                of_task[name] = BoardMetric(name, its["unit"], its["direction"], its["summary"], its["main"])
    return tuple(
        BoardTask(
            name, its["version"], its["options"], tuple(sorted(metrics[name].values(), key=lambda one: not one.main))
        )
        for name, its in sorted(found.items())
    )


def _completers(
    runs: Sequence[RunRows], merged: Sequence[MergedRow], data: Sequence[BoardData]
) -> tuple[BoardCompleter, ...]:
    found = {_identity_of_plugin(its): its for its in _described(merged).values()}
    cards = {
        _identity_of_plugin(described): described.get("card")
        for run in runs
        for described in run.configuration.get("completers", ())
    }
    alike: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for its in found.values():
        alike[its["name"]].append(its)
    labels = {identity: _label(its, alike[its["name"]]) for identity, its in found.items()}
    often = Counter(labels.values())
    completers = [
        BoardCompleter(
            # Options may differ in what their text does not tell: 1 and "1".
            label=labels[identity] + (f" #{digest(identity)[:6]}" if often[labels[identity]] > 1 else ""),
            name=its["name"],
            version=its["version"],
            options=its["options"],
            reference=its["reference"],
            weights=its["weights"],
            card=cards.get(identity),
            saw_test=seen_in_training(cards.get(identity), data),
        )
        for identity, its in found.items()
    ]
    return tuple(sorted(completers, key=lambda its: (not its.reference, its.label)))


def _label(plugin: Mapping[str, Any], alike: Sequence[Mapping[str, Any]]) -> str:
    """A completer's name, and in brackets what tells it from others of that name."""
    if len(alike) == 1:
        return str(plugin["name"])

    def differs(value_of: Any) -> bool:
        return len({canonical_json(value_of(one)) for one in alike}) > 1

    parts = [f"version {plugin['version']}"] if differs(lambda one: one["version"]) else []
    for option in sorted({name for one in alike for name in one["options"]}):
        if differs(lambda one, option=option: one["options"].get(option)):
            parts.append(f"{option}={plugin['options'].get(option)}")
    if differs(lambda one: one["weights"]):
        parts.append(f"weights {str(plugin['weights'])[:8]}")
    return f"{plugin['name']} ({', '.join(parts)})"


def _described(merged: Sequence[MergedRow]) -> Mapping[int, Mapping[str, Any]]:
    """What rows say of their completers, by object: many rows share few (see `merging`)."""
    return {id(one.row["completer"]): one.row["completer"] for one in merged}


def _labels(completers: Sequence[BoardCompleter], merged: Sequence[MergedRow]) -> Mapping[int, str]:
    """The label of each of the objects in `_described`."""
    label_of = {_identity(its): its.label for its in completers}
    return {number: label_of[_identity_of_plugin(its)] for number, its in _described(merged).items()}


def _identity_of_plugin(plugin: Mapping[str, Any]) -> str:
    return canonical_json([plugin[name] for name in ("name", "version", "options", "weights")])


def _identity(completer: BoardCompleter) -> str:
    return canonical_json([completer.name, completer.version, completer.options, completer.weights])


def _run(run: RunRows) -> BoardRun:
    facts = {name: run.facts[name] for name in _FACTS if run.facts.get(name) is not None}
    return BoardRun(facts, run.facts.get("calibration_seconds"))


def _cell(case: int, label: str, merged: Sequence[MergedRow]) -> BoardCell:
    measured = max(merged, key=lambda one: cost_measured(one.row))
    costs = measured.row.get("completing") or {}
    return BoardCell(
        case=case,
        completer=label,
        key=merged[0].row["cell"][:KEY_DIGITS],
        run=measured.run,
        seconds=costs.get("seconds"),
        memory_mb=costs.get("peak_memory_mb"),
        results={
            one.row["task"]["name"]: _result(one.row)
            for one in sorted(merged, key=lambda one: str(one.row["task"]["name"]))
        },
        cached=bool(costs.get("cached")),
    )


def _result(row: Mapping[str, Any]) -> BoardResult:
    values = {}
    main: tuple[float, ...] = ()
    for name, metric in row["metrics"].items():
        samples = metric["samples"]
        if samples:
            values[name] = float(f"{math.fsum(samples) / len(samples):.9g}")
        if metric["main"]:
            main = tuple(samples)
    return BoardResult(row["key"][:KEY_DIGITS], row["status"], row["error"], values, main)


def rankings_of(
    data: Sequence[BoardData],
    cases: Sequence[BoardCase],
    cells: Sequence[BoardCell],
    completers: Sequence[BoardCompleter],
    tasks: Sequence[BoardTask],
) -> dict[Table, Ranking]:
    """Who is shown to be better than whom, by table: (data, incompleteness, level, task)."""
    completer_of, task_of = {its.label: its for its in completers}, {its.name: its for its in tasks}
    tables: dict[Table, dict[str, list[Tried]]] = defaultdict(lambda: defaultdict(list))
    for cell in cells:
        case = cases[cell.case]
        for task, result in cell.results.items():
            environment = data[case.data].environments.get(case.scene, case.scene)
            tried = Tried(cell.case, environment, result.samples)
            tables[case.data, case.incompleteness, case.level, task][cell.completer].append(tried)
    rankings = {}
    for table, by_completer in sorted(tables.items()):
        main = task_of[table[3]].main
        if main is None:
            continue
        ranked = {label: its for label, its in by_completer.items() if not completer_of[label].reference}
        others = {label: its for label, its in by_completer.items() if completer_of[label].reference}
        rankings[table] = ranking(ranked, others, main.direction, main.summary)
    return rankings


def comparisons_of(rankings: Mapping[Table, Ranking]) -> tuple[Comparison, ...]:
    """The differences between completers that rankings were made from."""
    return tuple(
        Comparison(*table, its.first, its.second, its.difference, its.cases, its.better)
        for table, of_table in rankings.items()
        for its in of_table.differences
    )


def _standings(
    data: int,
    rows: Sequence[Mapping[str, Any]],
    rankings: Mapping[Table, Ranking],
    completers: Sequence[BoardCompleter],
    tasks: Sequence[BoardTask],
) -> list[Standing]:
    found = []
    for line in summarize(rows).to_dict("records"):
        table = (data, line["incompleteness"], line["level"], line["task"])
        ranks = rankings[table].ranks if line["main"] and table in rankings else {}

        def estimate(name: str, line: Mapping[str, Any] = line) -> Estimate | None:
            if math.isnan(line[name]):
                return None
            return Estimate(line[name], line[f"{name}_low"], line[f"{name}_high"])

        found.append(
            Standing(
                *table,
                metric=line["metric"],
                completer=line["completer"],
                scenes=line["scenes"],
                cases=line["cases"],
                failed=line["failed"],
                skipped=line["skipped"],
                missing=line["missing"],
                median=estimate("median"),
                p90=estimate("p90"),
                mean=estimate("mean"),
                rank=ranks.get(line["completer"]),
                seconds=line["seconds"],
                memory_mb=line["memory_mb"],
            )
        )
    return in_order(found, completers, tasks)


def in_order(
    standings: Iterable[Standing], completers: Sequence[BoardCompleter], tasks: Sequence[BoardTask]
) -> list[Standing]:
    """Standings of one data set as a board has them: table by table, metrics and completers in the board's order."""
    position = {its.label: number for number, its in enumerate(completers)}
    metric_position = {(task.name, metric.name): number for task in tasks for number, metric in enumerate(task.metrics)}
    return sorted(
        standings,
        key=lambda its: (
            its.incompleteness,
            its.level,
            its.task,
            metric_position.get((its.task, its.metric), -1),
            position[its.completer],
        ),
    )
