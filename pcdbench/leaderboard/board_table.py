"""`leaderboard.csv` and `leaderboard.parquet`: a board as one flat table, a line a (completer, level, metric)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from pcdbench.incompleteness import MEASURED
from pcdbench.leaderboard.statistics import Estimate
from pcdbench.runner.store import write_text

if TYPE_CHECKING:
    import pandas as pd

    from pcdbench.leaderboard.board import Board

COLUMNS = (
    "dataset",
    "split",
    "incompleteness",
    "level",
    "completer",
    "task",
    "metric",
    "unit",
    "cases",
    "failed",
    "median",
    "median_low",
    "median_high",
    "p90",
    "mean",
    "mean_low",
    "mean_high",
)


def board_table(board: Board) -> pd.DataFrame:
    """The board's standings with the columns `COLUMNS`.

    `level` is the share that is missing, the mean measured one where none was asked for; `cases` are those that
    were measured; what was not measured is NaN.
    """
    import pandas as pd

    unit = {(task.name, metric.name): metric.unit for task in board.tasks for metric in task.metrics}
    nothing = Estimate(math.nan, math.nan, math.nan)
    lines = []
    for its in board.standings:
        data = board.data[its.data]
        median, p90, mean = (estimate or nothing for estimate in (its.median, its.p90, its.mean))
        lines.append(
            (
                data.dataset,
                data.split,
                its.incompleteness,
                its.missing if its.level == MEASURED else its.level,
                its.completer,
                its.task,
                its.metric,
                unit.get((its.task, its.metric), ""),
                its.cases,
                its.failed,
                *(median.value, median.low, median.high),
                p90.value,
                *(mean.value, mean.low, mean.high),
            )
        )
    return pd.DataFrame(lines, columns=list(COLUMNS))


def write_tables(board: Board, folder: Path) -> None:
    """Write `leaderboard.csv` and `leaderboard.parquet`; equal boards give equal files."""
    import pyarrow
    from pyarrow import parquet

    table = board_table(board)
    write_text(folder / "leaderboard.csv", table.to_csv(index=False, float_format="%.9g", lineterminator="\n"))
    parquet.write_table(pyarrow.Table.from_pandas(table, preserve_index=False), folder / "leaderboard.parquet")
