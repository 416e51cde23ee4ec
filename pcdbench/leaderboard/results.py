"""The results of a run for notebooks and scripts: a table, and the figures of its tasks."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pcdbench.errors import PcdbenchError, told
from pcdbench.leaderboard.figures import figures_of
from pcdbench.leaderboard.summary import samples_table, summarize
from pcdbench.runner.row_shape import require_sound_rows
from pcdbench.runner.rows import Row
from pcdbench.runner.selection import Plugin
from pcdbench.runner.store import ROWS, RUN, read_rows, read_run, warn_of_missing_rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Figures(Mapping[str, "Figure"]):
    """Figures by name; a notebook shows them all."""

    def __init__(self, figures: Mapping[str, Figure]) -> None:
        self._figures = dict(figures)

    def __getitem__(self, name: str) -> Figure:
        return self._figures[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._figures)

    def __len__(self) -> int:
        return len(self._figures)

    def __repr__(self) -> str:
        return f"Figures({', '.join(self)})"

    def _repr_html_(self) -> str:
        from pcdbench.viewing.notebook import figures_html

        return figures_html(self.items()) or "<p>The tasks of this run draw no figures of its results.</p>"


def read_results(folder: str | Path, *, samples: bool = False) -> pd.DataFrame:
    """The results of a run as a table.

    Args:
        folder: of the run: what `--out` said, or one in `runs/`.
        samples: the single measurements, and not the summary: one line each, with its `value` (a location's, a
            step's, an object's; `sample` counts them within a case). What failed or was skipped has no lines here.

    Returns:
        Unless `samples`, what `pcdbench results --format csv` prints: one line for each task, metric,
        incompleteness, level and completer, with median, p90, mean and their intervals, and the numbers of
        failed and skipped cases.

    Raises:
        PcdbenchError: where there is no run, or nothing in it yet.
    """
    rows = rows_of_run(Path(folder))
    if not samples:
        return summarize(rows)
    table = samples_table(rows)
    table["sample"] = [np.arange(len(values)) for values in table["samples"]]
    table = table.explode(["sample", "samples"], ignore_index=True).dropna(subset="sample")
    return table.rename(columns={"samples": "value"}).astype({"value": float, "sample": int})


def read_figures(folder: str | Path) -> Figures:
    """What the tasks of a run draw of its results, drawn anew: matplotlib figures by `<task>_<name>`
    (`<task>_<name>_<incompleteness>` where there are several).

    A task that fails to draw is a warning.

    Raises:
        PcdbenchError: where there is no run, or nothing in it yet; where a task is not installed.
    """
    rows = rows_of_run(Path(folder))
    tasks = {row["task"]["name"]: row["task"] for row in rows}
    found: dict[str, Figure] = {}
    for name, task in tasks.items():
        try:
            plugin = Plugin("task", name, task["version"], task["options"])
            found |= {f"{name}_{its}": figure for its, figure in figures_of(plugin, rows).items()}
        except PcdbenchError:
            raise
        except Exception as error:
            # A task of a third party may raise anything; the figures of the others are still wanted.
            warnings.warn(f"{name} could not draw its figures: {told(error)}", stacklevel=2)
    return Figures(found)


def rows_of_run(folder: Path) -> Sequence[Row]:
    """All rows of a run.

    Raises:
        PcdbenchError: where there is no run, or nothing in it yet; where one of its rows is not what rows are.
    """
    facts, rows = read_run(folder), read_rows(folder)
    require_sound_rows(rows, folder / ROWS)
    if not rows:
        raise PcdbenchError(f"{folder} has no rows yet; give its command again to go on (it is in {folder / RUN})")
    warn_of_missing_rows(folder, facts, rows)
    return rows
