"""What a run draws: one case side by side, and the figures of its tasks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pcdbench.errors import told
from pcdbench.leaderboard.summary import level_text
from pcdbench.paths import file_name
from pcdbench.runner.completions import CompletionCache
from pcdbench.runner.execute import Executor, Failure
from pcdbench.runner.plan import Plan
from pcdbench.runner.selection import Plugin

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_case_picture(plan: Plan, rows: Sequence[Mapping[str, Any]], folder: Path) -> Path | None:
    """Draw the first case of the middle level that was completed: true, incomplete, and as each completer did it.

    Returns:
        `case_<scene>_<level>.png` in `folder`, or None where none was completed, or its scene is gone since.
    """
    from pcdbench.viewing.picture import write_picture

    # Here nothing is isolated: only what could be made and completed in a worker is made again.
    completed = {row["cell"] for row in rows if row["points"] is not None}
    levels = sorted({cell.level for cell in plan.cells})
    level = levels[len(levels) // 2]
    cells = [cell for cell in plan.cells if cell.key in completed and cell.level == level]
    if not cells:
        return None
    first = cells[0]
    shown = [cell for cell in cells if cell.case == first.case and not cell.completer.reference]
    executor = Executor(plan.dataset, CompletionCache())
    try:
        case = executor.case(first)
    except Failure:
        return None
    clouds = [("true", case.scene.complete), ("incomplete", case.cloud)]
    for cell in shown:
        try:
            clouds.append((cell.completer.name, executor.completion(cell, case)[0].cloud))
        except Failure:
            continue
    path = folder / f"case_{file_name(first.scene)}_{case.level:.3g}.png"
    title = f"{first.scene}: {level_text(first.level, case.level)} missing ({first.incompleteness.name})"
    write_picture(path, clouds, title, case.scene.complete)
    return path


def write_task_figures(plan: Plan, rows: Sequence[Mapping[str, Any]], folder: Path) -> tuple[list[Path], list[str]]:
    """Write what each task draws of its rows.

    Returns:
        The files `<task>_<name>.png` in `folder` (`<task>_<name>_<incompleteness>.png` where there are several), and a
        line for each task that failed to draw.
    """
    written, problems = [], []
    for plugin in plan.tasks:
        try:
            for name, figure in figures_of(plugin, rows).items():
                folder.mkdir(parents=True, exist_ok=True)
                path = folder / f"{plugin.name}_{file_name(name)}.png"
                figure.savefig(path, dpi=130)
                written.append(path)
        except Exception as error:
            problems.append(f"{plugin.name} could not draw its figures: {told(error)}")
    return written, problems


def figures_of(task: Plugin, rows: Sequence[Mapping[str, Any]]) -> Mapping[str, Figure]:
    """What a task draws of its rows, by name; nothing where it measured nothing.

    Each incompleteness has figures of its own, `<name>_<incompleteness>` where there are several.
    """
    import pandas as pd

    frame = pd.DataFrame([_drawn(row) for row in rows if row["status"] == "ok" and row["task"]["name"] == task.name])
    if frame.empty:
        return {}
    drawing = task.build()
    found: dict[str, Figure] = {}
    by_incompleteness = frame.groupby("incompleteness")
    for incompleteness, its in by_incompleteness:
        end = f"_{incompleteness}" if len(by_incompleteness) > 1 else ""
        found |= {f"{name}{end}": figure for name, figure in drawing.figures(its.reset_index(drop=True)).items()}
    return found


def _drawn(row: Mapping[str, Any]) -> dict[str, Any]:
    metrics = row["metrics"].items()
    return {
        "scene": row["scene"],
        "draw": row["draw"],
        "incompleteness": row["incompleteness"]["name"],
        "level": row["level"],
        "missing": math.nan if row.get("missing") is None else row["missing"],
        "completer": row["completer"]["name"],
        "samples": {name: metric["samples"] for name, metric in metrics},
        "labels": {name: metric["labels"] for name, metric in metrics if "labels" in metric},
        "trace": row["trace"],
    }
