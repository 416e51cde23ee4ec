"""Runs on disk with rows as a run would store them, without running anything."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pcdbench.keys import digest

REFERENCES = ("ground_truth", "incomplete", "resample")


def full_row(
    completer: str,
    samples: Sequence[float] = (),
    *,
    scene: str = "room0",
    level: float = 0.3,
    task: str = "task",
    metric: str = "error_m",
    direction: str = "lower",
    summary: str = "mean",
    status: str = "ok",
    error: str | None = None,
    seconds: float = 1.0,
    options: dict[str, Any] | None = None,
    version: str = "1",
    weights: str | None = None,
    dataset_version: str = "1",
    task_version: str = "1",
    scene_digest: str | None = None,
    incompleteness: str = "holes",
    time: str = "2026-01-01T00:00:00Z",
) -> dict[str, Any]:
    dataset = {"name": "rooms", "version": dataset_version, "options": {}, "digest": scene_digest or scene}
    plugin = {"name": completer, "version": version, "options": options or {}, "weights": weights}
    cell = digest([dataset, scene, incompleteness, level, plugin])
    meaning = {"unit": "m", "direction": direction, "summary": summary, "main": True, "samples": list(samples)}
    return {
        "key": digest([cell, task, task_version]),
        "cell": cell,
        "dataset": dataset,
        "scene": scene,
        "draw": 0,
        "incompleteness": {"name": incompleteness, "version": "1", "options": {}},
        "level": level,
        "seed": 1,
        "completer": plugin | {"reference": completer in REFERENCES},
        "task": {"name": task, "version": task_version, "options": {}},
        "status": status,
        "stage": None if status == "ok" else "completing",
        "error": error,
        "metrics": {metric: meaning} if status == "ok" else {},
        "trace": {},
        "missing": level,
        "completing": {"seconds": seconds, "peak_memory_mb": 2.0, "cached": False} if status == "ok" else None,
        "host": "h",
        "time": time,
    }


def store_run(
    folder: Path,
    rows: Iterable[dict[str, Any]],
    *,
    cards: dict[str, Any] | None = None,
    code: str | None = None,
    planned: int | None = None,
    calibration: float | None = 1.0,
    cpu: str = "a processor",
    split: str = "test",
    time: str = "2026-01-01T00:00:00Z",
) -> Path:
    """Store rows as a run; `cards` are model cards by completer, `code` the digest of what completed, `planned`
    how many rows it was to have.
    """
    rows = list(rows)
    folder.mkdir(parents=True, exist_ok=True)
    completers = {digest(row["completer"]): row["completer"] for row in rows}.values()
    described = [
        dict(its) | ({"card": cards[its["name"]]} if cards and its["name"] in cards else {}) for its in completers
    ]
    if code is not None:
        described = [its | {"code": code} for its in described]
    facts = {
        "schema_version": 1,
        "configuration": {"split": split, "seed": 0, "completers": described},
        "time": time,
        "calibration_seconds": calibration,
        "machine": {"cpu": cpu, "cores": 2},
    } | ({} if planned is None else {"planned_rows": planned})
    (folder / "run.json").write_text(json.dumps(facts))
    (folder / "rows.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder
