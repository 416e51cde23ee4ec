"""Rows of several runs as one set: what is there twice must agree, and what must not mix is an error."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pcdbench.downloads import is_address, kept_download
from pcdbench.errors import PcdbenchError
from pcdbench.keys import canonical_json
from pcdbench.leaderboard.board import metric_meaning
from pcdbench.leaderboard.run_shape import require_sound_facts, require_sound_keys, require_sound_plugin
from pcdbench.leaderboard.summary import level_text
from pcdbench.runner.row_shape import require_sound_rows
from pcdbench.runner.rows import FOREKNOWN, cost_measured
from pcdbench.runner.store import ELSEWHERE, ROWS, RUN, read_rows, read_run, warn_of_missing_rows

# Machines round differently; what they measure of one key differs by less than this share of the value.
AGREEMENT = 1e-3
_DESCRIBED = ("dataset", "incompleteness", "completer", "task")
_KEPT = ("key", "cell", "scene", "draw", "level", "status", "error", "missing", FOREKNOWN, "completing", "host", "time")


@dataclass(frozen=True)
class RunRows:
    """Rows of a run that were measured on one machine, without what boards do not use, and what `run.json` says."""

    folder: Path
    facts: Mapping[str, Any]
    rows: Sequence[Mapping[str, Any]]

    @property
    def configuration(self) -> Mapping[str, Any]:
        return self.facts["configuration"]

    @property
    def order(self) -> str:
        """What sorts runs, wherever they lie and in whatever order they are named."""
        return canonical_json([self.facts.get("time") or "", self.configuration])


@dataclass(frozen=True)
class MergedRow:
    """A row, and which of the runs it is from."""

    row: Mapping[str, Any]
    run: int


def read_runs(folders: Iterable[Path]) -> list[RunRows]:
    """The runs in these folders, apart by machine; a folder that is none may hold some. Sorted, each once.

    Raises:
        PcdbenchError: where there is no run, one is damaged, or one has no rows.
    """
    found = {path.resolve(): path for path in _run_folders(folders)}
    return sorted((run for path in found.values() for run in _read(path)), key=lambda run: run.order)


def data_paths(folders: Iterable[Path]) -> dict[str, str | None]:
    """Where the data sets of these runs lay, by name; None for those that were not told.

    What lay at an address is where it was kept; nothing is fetched because a run says so.

    Raises:
        PcdbenchError: where there is no run, or one is damaged.
    """
    paths: dict[str, str | None] = {}
    for folder in _run_folders(folders):
        facts = read_run(folder)
        require_sound_facts(facts, folder / RUN)
        dataset, place = facts["configuration"].get("dataset"), facts.get("dataset_path")
        if dataset is not None:
            kept = kept_download(place) if place is not None and is_address(place) else place
            paths[dataset["name"]] = None if kept is None else str(kept)
    return paths


def _run_folders(folders: Iterable[Path]) -> list[Path]:
    """The folders of runs among these and in those of them that are none, each once.

    Raises:
        PcdbenchError: where one cannot be looked into.
    """
    found: dict[Path, Path] = {}
    for folder in folders:
        try:
            inner = _runs_in(folder)
        except OSError as error:
            raise PcdbenchError(f"{folder} cannot be read ({error.strerror}); give the folder of a run") from None
        for path in inner or [folder]:
            found.setdefault(path.resolve(), path)
    return list(found.values())


def _runs_in(folder: Path, depth: int = 2) -> list[Path]:
    """The folder of a run itself, else those of the runs in it: a suite of several seeds has one for each."""
    if (folder / RUN).exists():
        return [folder]
    inner = sorted(path for path in folder.iterdir() if path.is_dir()) if depth and folder.is_dir() else []
    return [run for path in inner for run in _runs_in(path, depth - 1)]


def merge(runs: Sequence[RunRows]) -> list[MergedRow]:
    """All rows of these runs, each key once in a split, sorted.

    Raises:
        PcdbenchError: where two runs have other data, tasks or incompletenesses under one name, or two rows of one
            key do not agree; it names both.
    """
    _refuse_other_versions(runs)
    merged: dict[tuple[str, str], MergedRow] = {}
    for number, run in enumerate(runs):
        for row in run.rows:
            key = (row["key"], str(run.configuration["split"]))
            one, other = MergedRow(row, number), merged.get(key)
            if other is None:
                merged[key] = one
                continue
            difference = _difference(other.row, row)
            if difference:
                place, told = (" ".join(text.split()) for text in (_place(row), difference))
                raise PcdbenchError(
                    f"{runs[other.run].folder} and {run.folder} do not agree on {place}: {told} "
                    f"(key {row['key'][:16]}); leave one of them out, or find out which is right and run it again"
                )
            merged[key] = max(other, one, key=_precedence)
    return [merged[key] for key in sorted(merged)]


def _read(folder: Path) -> list[RunRows]:
    facts = read_run(folder)
    require_sound_facts(facts, folder / RUN)
    shared: dict[str, Any] = {}
    rows, path = [], folder / ROWS
    for row in read_rows(folder):
        require_sound_rows([row], path)
        require_sound_keys(row, path)
        rows.append(_slim(row, shared, path))
    if not rows:
        raise PcdbenchError(f"{folder} has no rows yet; give its command again to go on (it is in {folder / RUN})")
    warn_of_missing_rows(folder, facts, rows)
    elsewhere = facts.get(ELSEWHERE, {})
    by_host = defaultdict(list)
    for row in rows:
        host = str(row["host"])
        by_host[host if host in elsewhere else ""].append(row)
    return [RunRows(folder, {**facts, **elsewhere.get(host, {})}, its) for host, its in by_host.items()]


def _slim(row: Mapping[str, Any], shared: dict[str, Any], path: Path) -> dict[str, Any]:
    """A row without what boards do not use; what many rows say alike is kept once, in `shared`."""
    slim = {name: row.get(name) for name in _KEPT}
    for name in _DESCRIBED:
        key = f"{name} {row.get(name)!r}"
        if key not in shared:
            require_sound_plugin(name, row.get(name), path)
            shared[key] = row[name]
        slim[name] = shared[key]
    slim["metrics"] = {
        name: {which: value for which, value in metric.items() if which != "labels"}
        for name, metric in row["metrics"].items()
    }
    return slim


def _refuse_other_versions(runs: Sequence[RunRows]) -> None:
    """Raise where one name stands for two things whose numbers must not stand beside one another."""
    seen: dict[tuple[str, ...], tuple[str, Path]] = {}

    def check(run: RunRows, kind: str, name: str, told: str) -> None:
        before, folder = seen.setdefault((kind, name), (told, run.folder))
        if before != told:
            where = " ".join(f"{kind} {name} at {before}, {run.folder} at {told}".split())
            raise PcdbenchError(
                f"{folder} has {where}: their numbers do not mix; build a board of each, or run one of them again"
            )

    for run in runs:
        for its in run.configuration.get("completers", ()):
            if its.get("code") and not its.get("reference"):
                check(run, "completer", f"{its['name']} {version_text(its['version'], {})}", f"code {its['code'][:16]}")
        told_of = set[tuple[str, ...]]()
        for row in run.rows:
            dataset = row["dataset"]
            if (metrics := (row["task"]["name"], *row["metrics"])) not in told_of:
                told_of.add(metrics)
                for name, its in row["metrics"].items():
                    meaning = metric_meaning(its["direction"], its["summary"], its["main"])
                    check(run, f"metric {name} of task", row["task"]["name"], meaning)
            check(run, "data set", dataset["name"], _version_of(dataset))
            check(run, f"scene {row['scene']} of data set", dataset["name"], f"digest {dataset['digest'][:16]}")
            check(run, "incompleteness", row["incompleteness"]["name"], _version_of(row["incompleteness"]))
            check(run, "task", row["task"]["name"], _version_of(row["task"]))


def version_text(version: str, options: Mapping[str, Any]) -> str:
    """What must be the same for numbers to stand beside one another, for messages."""
    told = ", ".join(f"{name}={value}" for name, value in sorted(options.items()))
    return f"version {version}" + (f" ({told})" if told else "")


def _version_of(plugin: Mapping[str, Any]) -> str:
    return version_text(plugin["version"], plugin["options"])


def _place(row: Mapping[str, Any]) -> str:
    case = f"{row['scene']} ({row['incompleteness']['name']}, {level_text(row['level'])})"
    return f"{row['task']['name']} of {row['completer']['name']} in {case}"


def _difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """How two rows of one key differ by more than machines do; empty where they agree."""
    outcomes = [_outcome(row) for row in (one, other)]
    if outcomes[0] != outcomes[1]:
        return f"{outcomes[0]} there, {outcomes[1]} here"
    for name in sorted({**one["metrics"], **other["metrics"]}):
        values, others = (row["metrics"].get(name, {}).get("samples", []) for row in (one, other))
        if len(values) != len(others):
            return f"{name} has {len(values)} samples there, {len(others)} here"
        for value, its in zip(values, others, strict=True):
            if not math.isclose(value, its, rel_tol=AGREEMENT, abs_tol=1e-9):
                return f"{name} is {value:.6g} there, {its:.6g} here"
    return ""


def _outcome(row: Mapping[str, Any]) -> str:
    """The status of a row; how something failed may differ between machines."""
    return "failed" if row["status"] == "timeout" else row["status"]


def _precedence(merged: MergedRow) -> tuple[tuple[bool, str], str]:
    """What decides, of two rows that agree, in whatever order they came: the newest has the costs of today."""
    row = merged.row
    return cost_measured(row), canonical_json([row.get("host") or "", row["metrics"], row.get("completing")])
