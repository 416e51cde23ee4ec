"""`pcdbench leaderboard`: boards from runs, and the check that holds changes to them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(no_args_is_help=True, help="Leaderboards from runs, and the check that holds changes to them.")


@app.callback()
def _leaderboard() -> None:
    """Leaderboards from runs, and the check that holds changes to them."""


@app.command("build")
def build(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs, or folders that hold some.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The board's folder; it is called as the folder is.")],
) -> None:
    """Merge runs into a leaderboard: leaderboard.json, README.md, index.html, figures, leaderboard.csv and .parquet.

    The runs may be of any machines, in any order. The same cell twice must agree; runs of different versions of
    data, tasks or incompletenesses do not mix.
    """
    from pcdbench.leaderboard.building import board_of_runs
    from pcdbench.leaderboard.publishing import publish

    board = board_of_runs(out.resolve().name, runs)
    for path in publish(board, out):
        typer.echo(str(path))
