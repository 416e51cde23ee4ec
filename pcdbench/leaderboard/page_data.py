"""A board as its page's script takes it: names once, numbers in columns, packed and in base64."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.incompleteness import MEASURED
from pcdbench.leaderboard.audit import CEILING, FLOOR, TRUTH
from pcdbench.leaderboard.board import Board, BoardCompleter, BoardData, BoardMetric, BoardTask
from pcdbench.leaderboard.statistics import Estimate
from pcdbench.leaderboard.summary import STATISTICS
from pcdbench.viewing.payload import base64_text

CURVE_STEPS = 100
# A page with all samples of 300 scenes and 20 completers would be as large as a film; every one has four characters.
SAMPLES_AT_MOST = 1_500_000
_ROLES = {TRUTH: "truth", CEILING: "ceiling", FLOOR: "floor"}
_STATUSES = ("ok", "failed", "timeout", "skipped")
_NOT_RUN = len(_STATUSES)
_KEY_BYTES = 8
_SHOWN_WEIGHTS = 16


@dataclass(frozen=True)
class _Index:
    """Where everything is in the columns; settings are (data, incompleteness, level), metrics (task, name).

    `main` is each task's main metric among the metrics.
    """

    settings: Mapping[tuple[int, str, float], int]
    metrics: Mapping[tuple[str, str], int]
    main: Mapping[str, int]
    completers: Mapping[str, int]
    tasks: Mapping[str, int]


def page_payload(board: Board) -> dict[str, Any]:
    """All that the page shows, JSON values alone.

    Lists of names: `datasets`, `incompletenesses`, `tasks`, `metrics`, `completers`, `scenes`, `reasons`; `settings`,
    each (dataset, incompleteness, level) that occurs, with the mean share found missing; `first_setting`, what is
    shown at first.
    By (setting, metric, completer), the last one fastest: `estimates` (float32: value, low, high of each statistic;
    NaN where there is none), `counts` (uint16: cases, failed, skipped, ranks; no rank is 0), `curves` (quantiles at
    `curve_steps` + 1 even shares: of all samples for a task's main metric, of the means of cases for the others).
    By (setting, completer): `seconds`, `memory_mb` (float32).
    By case: `case_settings`, `case_scenes`, `case_draws`, `case_seeds` (uint16, in `seeds`). By (case, completer):
    `case_seconds`. By (case, completer, task): `statuses` (uint8), `keys` (8 bytes, the first 16 digits),
    `row_reasons` (uint16, 1 + the place in `reasons`, or 0). By (metric, case, completer): `values`, the means.
    `samples_of` by metric: null, or `counts` (uint16, by (case, completer)) and `values`, one after the other.
    Other numbers are "short floats", the upper three bytes of float32. All are little endian.
    """
    metrics = {
        key: place for place, key in enumerate((task.name, its.name) for task in board.tasks for its in _metrics(task))
    }
    index = _Index(
        settings={key: place for place, key in enumerate(_settings(board))},
        metrics=metrics,
        main={task.name: metrics[task.name, _metrics(task)[0].name] for task in board.tasks},
        completers={completer.label: place for place, completer in enumerate(board.completers)},
        tasks={task.name: place for place, task in enumerate(board.tasks)},
    )
    incompletenesses = [its.name for its in board.incompletenesses]
    return {
        "datasets": [{"label": label} for label in _data_labels(board.data)],
        "incompletenesses": incompletenesses,
        "settings": [
            {
                "dataset": data,
                "incompleteness": incompletenesses.index(incompleteness),
                "level": level,
                "missing": _missing(board, data, incompleteness, level),
            }
            for data, incompleteness, level in index.settings
        ],
        "first_setting": _first_setting(list(index.settings)),
        "tasks": [{"name": task.name} for task in board.tasks],
        "metrics": [
            {
                "task": index.tasks[task.name],
                "name": its.name,
                "unit": its.unit,
                "direction": its.direction,
                "summary": its.summary,
                "main": its.main,
            }
            for task in board.tasks
            for its in _metrics(task)
        ],
        "completers": [_completer(board, completer) for completer in board.completers],
        **_standings(board, index),
        **_cells(board, index),
    }


def _metrics(task: BoardTask) -> Sequence[BoardMetric]:
    """A task's metrics; nobody knows them where it failed on everything, and its failures still are to be seen."""
    return task.metrics or (BoardMetric("", "", "lower", "median", True),)


def _settings(board: Board) -> list[tuple[int, str, float]]:
    """By data and incompleteness in the board's order, levels ascend."""
    order = {its.name: place for place, its in enumerate(board.incompletenesses)}
    found = {(case.data, case.incompleteness, case.level) for case in board.cases}
    return sorted(found, key=lambda key: (key[0], order[key[1]], key[2]))


def _first_setting(settings: Sequence[tuple[int, str, float]]) -> int:
    """The middle level of the first data set and incompleteness."""
    beside = [place for place, key in enumerate(settings) if key[:2] == settings[0][:2]]
    return beside[len(beside) // 2]


def _missing(board: Board, data: int, incompleteness: str, level: float) -> float | None:
    """The mean share that was found missing, where no level was asked for."""
    if level != MEASURED:
        return None
    its = [
        case.missing
        for case in board.cases
        if (case.data, case.incompleteness, case.level) == (data, incompleteness, level) and case.missing is not None
    ]
    return float(np.mean(its)) if its else None


def _data_labels(data: Sequence[BoardData]) -> list[str]:
    """Names, with what tells them apart where one is there twice."""
    for told in (
        [its.dataset for its in data],
        [f"{its.dataset} {its.split}" for its in data],
        [f"{its.dataset} {its.version} {its.split}" for its in data],
    ):
        if len(set(told)) == len(told):
            return told
    return [f"{its.dataset} {its.version} {its.split} ({number})" for number, its in enumerate(data, 1)]


def _completer(board: Board, completer: BoardCompleter) -> dict[str, Any]:
    facts = [["version", completer.version]]
    facts += [[name, str(value)] for name, value in sorted(completer.options.items())]
    if completer.weights:
        facts.append(["weights", completer.weights[:_SHOWN_WEIGHTS]])
    flags = []
    if completer.saw_test:
        flags.append({"text": "saw test scenes", "why": completer.saw_test})
    if completer.label in board.completed_elsewhere:
        flags.append({"text": "completed elsewhere", "why": "how its clouds were made, and at what cost, is not known"})
    if completer.foreknew:
        flags.append({"text": "knew what was taken away", "why": completer.foreknew})
    role = _ROLES.get(completer.name, "reference") if completer.reference else None
    return {"name": completer.label, "role": role, "facts": facts, "flags": flags}


def _standings(board: Board, index: _Index) -> dict[str, Any]:
    shape = (len(index.settings), len(index.metrics), len(index.completers))
    found = {name: np.full((*shape, 3), np.nan, "<f4") for name in STATISTICS}
    counts = {name: np.zeros(shape, "<u2") for name in ("cases", "failed", "skipped", "ranks")}
    cost = {name: np.full(shape[::2], np.nan, "<f4") for name in ("seconds", "memory_mb")}
    for its in board.standings:
        setting = index.settings[its.data, its.incompleteness, its.level]
        completer = index.completers[its.completer]
        cost["seconds"][setting, completer], cost["memory_mb"][setting, completer] = its.seconds, its.memory_mb
        # What was lost where nothing was measured is counted with the metric that the page shows of the task at first.
        metric = index.metrics[its.task, its.metric] if its.metric else index.main[its.task]
        at = setting, metric, completer
        for name in STATISTICS:
            estimate: Estimate | None = getattr(its, name)
            if estimate is not None:
                found[name][at] = estimate.value, estimate.low, estimate.high
        for name, count in (("cases", its.cases), ("failed", its.failed), ("skipped", its.skipped)):
            counts[name][at] = count
        counts["ranks"][at] = its.rank or 0
    return {
        "estimates": {name: base64_text(array) for name, array in found.items()},
        "counts": {name: base64_text(array) for name, array in counts.items()},
        **{name: base64_text(array) for name, array in cost.items()},
    }


def _cells(board: Board, index: _Index) -> dict[str, Any]:
    scenes = {name: place for place, name in enumerate(dict.fromkeys(case.scene for case in board.cases))}
    seeds = {seed: place for place, seed in enumerate(dict.fromkeys(case.seed for case in board.cases))}
    settings = np.array(
        [index.settings[case.data, case.incompleteness, case.level] for case in board.cases], dtype="<u2"
    )
    shape = (len(board.cases), len(index.completers))
    statuses = np.full((*shape, len(index.tasks)), _NOT_RUN, np.uint8)
    keys = np.zeros((*shape, len(index.tasks), _KEY_BYTES), np.uint8)
    whys = np.zeros((*shape, len(index.tasks)), "<u2")
    case_seconds = np.full(shape, np.nan, "<f4")
    values = np.full((len(index.metrics), *shape), np.nan, "<f4")
    samples: dict[int, dict[tuple[int, int], Sequence[float]]] = {}
    reasons: dict[str, int] = {}
    for cell in board.cells:
        at = cell.case, index.completers[cell.completer]
        if cell.seconds is not None:
            case_seconds[at] = cell.seconds
        for task, result in cell.results.items():
            row = (*at, index.tasks[task])
            statuses[row] = _STATUSES.index(result.status)
            keys[row] = np.frombuffer(bytes.fromhex(result.key[: 2 * _KEY_BYTES]), np.uint8)
            if result.error:
                # Reasons are few, but each may name a scene or a number; the last places hold them all.
                whys[row] = min(reasons.setdefault(result.error, len(reasons) + 1), np.iinfo(whys.dtype).max)
            for name, value in result.values.items():
                values[(index.metrics[task, name], *at)] = value
            if result.samples:
                samples.setdefault(index.main[task], {})[at] = result.samples
    return {
        "scenes": list(scenes),
        "seeds": list(seeds),
        "reasons": list(reasons)[: np.iinfo(whys.dtype).max],
        "case_settings": base64_text(settings),
        "case_scenes": base64_text(np.array([scenes[case.scene] for case in board.cases], dtype="<u2")),
        "case_draws": base64_text(np.array([case.draw for case in board.cases], dtype="<u2")),
        "case_seeds": base64_text(np.array([seeds[case.seed] for case in board.cases], dtype="<u2")),
        "statuses": base64_text(statuses),
        "keys": base64_text(keys),
        "row_reasons": base64_text(whys),
        "case_seconds": packed_floats(case_seconds),
        "values": packed_floats(values),
        "samples_of": _samples(samples, shape, len(index.metrics)),
        "curve_steps": CURVE_STEPS,
        "curves": packed_floats(_curves(values, samples, settings, len(index.settings))),
    }


def _samples(
    samples: Mapping[int, Mapping[tuple[int, int], Sequence[float]]], shape: tuple[int, int], metrics: int
) -> list[dict[str, str] | None]:
    """Those of each metric, one after the other; of the metrics with the most samples none, where all are too many."""
    packed: list[dict[str, str] | None] = [None] * metrics
    left = SAMPLES_AT_MOST
    for metric, its in sorted(samples.items(), key=lambda item: sum(map(len, item[1].values()))):
        left -= sum(map(len, its.values()))
        if left < 0:
            break
        counts = np.zeros(shape, "<u2")
        if max(map(len, its.values()), default=0) > np.iinfo(counts.dtype).max:
            continue
        for at, of_case in its.items():
            counts[at] = len(of_case)
        values = np.concatenate([its[at] for at in sorted(its)])
        packed[metric] = {"counts": base64_text(counts), "values": packed_floats(values)}
    return packed


def _curves(
    values: NDArray[np.float32],
    samples: Mapping[int, Mapping[tuple[int, int], Sequence[float]]],
    settings: NDArray[np.uint16],
    count: int,
) -> NDArray[np.float32]:
    """(settings, metrics, completers, steps + 1) quantiles of the samples, where they are known, else of the values."""
    shares = np.linspace(0, 1, CURVE_STEPS + 1)
    metrics, _, completers = values.shape
    curves = np.full((count, metrics, completers, len(shares)), np.nan, np.float32)
    cases_of = [np.flatnonzero(settings == setting) for setting in range(count)]
    for setting, metric, completer in np.ndindex(curves.shape[:3]):
        cases = cases_of[setting]
        if metric in samples:
            parts = [its for case in cases if (its := samples[metric].get((int(case), completer)))]
            known = np.concatenate(parts) if parts else np.empty(0)
        else:
            known = values[metric, cases, completer]
            known = known[np.isfinite(known)]
        if len(known):
            curves[setting, metric, completer] = np.quantile(known, shares)
    return curves


def packed_floats(array: NDArray[Any]) -> str:
    """The upper three bytes of each number as float32, rounded: five digits."""
    bits = np.ascontiguousarray(array, dtype="<f4").reshape(-1).view("<u4").astype(np.uint64)
    # Numbers that are not finite must stay so: rounding would carry into their sign.
    finite = np.isfinite(np.asarray(array, dtype=np.float32)).reshape(-1)
    rounded = np.where(finite, np.minimum(bits + 0x80, 0xFFFFFFFF), bits).astype("<u4")
    return base64_text(rounded.view(np.uint8).reshape(-1, 4)[:, 1:])
