"""Boards as runs would give them, made without running anything: of any size, with any names."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

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
    Standing,
)
from pcdbench.leaderboard.statistics import Estimate

TASKS = {
    "chamfer": [("chd", "normalised", "lower", 1), ("accuracy_m", "m", "lower", 1), ("f_score", "share", "higher", 1)],
    "ssim": [("ssim", "SSIM, at most 1", "higher", 1)],
    "localization": [("localization_error_m", "m", "lower", 10), ("success", "share", "higher", 10)],
    "tracking": [("tracking_error_m", "m", "lower", 30), ("final_drift_m", "m", "lower", 1)],
}
REFERENCES = ("ground_truth", "resample", "incomplete")


def made_board(
    completers: Sequence[str] = ("planes", "holes", "network"),
    scenes: Sequence[str] = ("hall", "office", "kitchen", "lobby"),
    *,
    name: str = "rooms",
    data: Sequence[str] = ("indoor",),
    incompletenesses: Sequence[str] = ("holes", "short_scan"),
    levels: Sequence[float] = (0.1, 0.3, 0.5),
    tasks: Sequence[str] = tuple(TASKS),
    failing: str = "",
    saw_test: str = "",
    error: str = "ran out of luck",
) -> Board:
    """A board in which each completer is worse than the one before it, and everything at a higher level.

    Args:
        failing: a completer that fails on the first scene, with this error.
        saw_test: a completer that was trained on the first scene.
    """
    rng = np.random.default_rng(0)
    labels = [*REFERENCES, *completers]
    cases = [
        BoardCase(place, scene, incompleteness, level, 0, 0, level)
        for place in range(len(data))
        for incompleteness in incompletenesses
        for level in levels
        for scene in scenes
    ]
    cells, pooled = [], {}
    for number, case in enumerate(cases):
        for rank, label in enumerate(labels):
            failed = label == failing and case.scene == scenes[0]
            key = hashlib.sha256(f"{number} {label}".encode()).hexdigest()[:16]
            results = {}
            for task in tasks:
                its = hashlib.sha256(f"{number} {label} {task}".encode()).hexdigest()[:16]
                if failed:
                    results[task] = BoardResult(its, "failed", error)
                    continue
                values = {}
                for metric, _, direction, count in TASKS[task]:
                    drawn = rng.lognormal(np.log(0.02 * case.level * (1 + rank)), 0.5, count)
                    samples = 1 - drawn if direction == "higher" else drawn
                    pooled.setdefault((case.data, case.incompleteness, case.level, task, metric, label), []).append(
                        (case.scene, samples)
                    )
                    values[metric] = float(samples.mean())
                    if metric == TASKS[task][0][0]:
                        main = tuple(samples.tolist())
                results[task] = BoardResult(its, "ok", None, values, main)
            cells.append(BoardCell(number, label, key, 0, None if failed else 0.1 * (1 + rank), 20.0 * rank, results))
    return Board(
        name=name,
        data=tuple(BoardData(its, "2", {}, "test-small", dict.fromkeys(scenes, "0")) for its in data),
        incompletenesses=tuple(BoardIncompleteness(its, "1", {}) for its in incompletenesses),
        tasks=tuple(
            BoardTask(
                task,
                "1",
                {},
                tuple(
                    BoardMetric(metric, unit, direction, "median", place == 0)
                    for place, (metric, unit, direction, _) in enumerate(TASKS[task])
                ),
            )
            for task in tasks
        ),
        completers=tuple(
            BoardCompleter(
                label,
                label,
                "1",
                {"reach_m": 0.5},
                label in REFERENCES,
                saw_test=f"its card names {scenes[0]}" if label == saw_test else "",
            )
            for label in labels
        ),
        runs=(BoardRun({"time": "2026-11-22T10:00:00Z"}, None),),
        cases=tuple(cases),
        cells=tuple(cells),
        standings=tuple(
            _standing(key, its, labels, len(scenes), ranked=key[4] == TASKS[key[3]][0][0])
            for key, its in pooled.items()
        ),
        comparisons=(),
    )


def _standing(
    key: tuple[int, str, float, str, str, str],
    its: Sequence[tuple[str, np.ndarray]],
    labels: Sequence[str],
    tried: int,
    *,
    ranked: bool,
) -> Standing:
    samples = np.concatenate([samples for _, samples in its])
    values = {"median": np.median(samples), "p90": np.quantile(samples, 0.9), "mean": samples.mean()}
    # Intervals of any kind will do: whoever shows a board computes none.
    found = {name: Estimate(float(value), 0.9 * float(value), 1.2 * float(value)) for name, value in values.items()}
    place = labels.index(key[5])
    return Standing(
        *key,
        scenes=len(its),
        cases=len(its),
        failed=tried - len(its),
        skipped=0,
        missing=key[2],
        median=found["median"],
        p90=found["p90"],
        mean=found["mean"],
        rank=max(1, place - len(REFERENCES)) if ranked and key[5] not in REFERENCES else None,
        seconds=0.1 * (1 + place),
        memory_mb=20.0 * place,
    )
