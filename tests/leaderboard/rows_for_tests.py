"""Result rows as a run would store them, without running anything."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def result_row(
    completer: str,
    samples: Sequence[float],
    *,
    scene: str = "room",
    draw: int = 0,
    level: float = 0.3,
    task: str = "task",
    metric: str = "error_m",
    direction: str = "lower",
    status: str = "ok",
    error: str | None = None,
    seconds: float = 1.0,
) -> dict[str, Any]:
    meaning = {"unit": "m", "direction": direction, "summary": "mean", "main": True, "samples": list(samples)}
    return {
        "cell": f"{completer} {scene} {draw} {level}",
        "scene": scene,
        "draw": draw,
        "incompleteness": {"name": "holes"},
        "level": level,
        "completer": {"name": completer, "reference": completer in ("ground_truth", "resample", "incomplete")},
        "task": {"name": task},
        "status": status,
        "error": error,
        "metrics": {metric: meaning} if status == "ok" else {},
        "completing": {"seconds": seconds, "peak_memory_mb": 2.0} if status == "ok" else None,
    }
