"""`pcdbench leaderboard case`: what is behind a number of a board, made again and shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from pcdbench.leaderboard.board import Board, BoardCell

_FEWEST_DIGITS = 6


def case(
    board: Annotated[Path, typer.Argument(help="The folder of a board.")],
    key: Annotated[str, typer.Argument(help="Six or more of the first digits of a row's or a cell's key.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The page with the clouds.")] = Path("case.html"),
    dataset: Annotated[str | None, typer.Option(help="NAME:PATH: where the data of the board lie here.")] = None,
) -> None:
    """Make a case of a board and all its completions again, measure the row again, and write a page with the clouds.

    Exit code 1 where a number differs from the board's.
    """
    from pcdbench.leaderboard.board_file import read_board
    from pcdbench.leaderboard.case_clouds import Remaking
    from pcdbench.viewing.page import FLUENT_POINTS, View, require_page

    require_page(out)
    read = read_board(board)
    cell, tasks = _found(read, key)
    name, _, path = (dataset or "").partition(":")
    # What a completer gave in the run may be in the cache; that it gives it for this case alone is the question.
    remaking = Remaking(read, {name: path or None}, anew=True)
    rows = remaking.rows(cell, tasks)
    clouds, problems = remaking.clouds(cell.case, FLUENT_POINTS)
    for problem in problems:
        typer.echo(f"pcdbench: without clouds: {problem}", err=True)
    same = all([_told(cell, row) for row in rows])
    View(clouds.shown, clouds.title).write(out)
    typer.echo(f"{out}: {clouds.title}, {len(clouds.shown)} clouds")
    if not same:
        raise typer.Exit(1)


def _found(board: Board, key: str) -> tuple[BoardCell, Sequence[str]]:
    """The cell, and the one task of it that a row's key means, or all tasks for the cell's own key."""
    from pcdbench.errors import PcdbenchError

    if len(key) < _FEWEST_DIGITS:
        raise PcdbenchError(f"{key!r} is too short for a key; give at least {_FEWEST_DIGITS} digits of it")
    # Boards keep the first 16 digits of a key; their page puts an ellipsis after them, and `rows.jsonl` has all 64.
    wanted = key.rstrip("…")
    # Splits that overlap have cells of the same key: they are the same.
    found = {
        its: (cell, tasks)
        for cell in board.cells
        for its, tasks in [(cell.key, list(cell.results)), *((row.key, [task]) for task, row in cell.results.items())]
        if its.startswith(wanted[: len(its)])
    }
    if len(found) != 1:
        told = f"{len(found)} keys of board {board.name} begin" if found else f"no key of board {board.name} begins"
        raise PcdbenchError(f"{told} with {key}; the rows that a number of the page leads to have their keys")
    return next(iter(found.values()))


def _told(cell: BoardCell, row: Mapping[str, Any]) -> bool:
    """Print the row's numbers beside those of the board; whether they are the same."""
    import math

    from pcdbench.leaderboard.merging import AGREEMENT

    task = row["task"]["name"]
    known = cell.results[task]
    if row["status"] != "ok" or known.status != "ok":
        now = row["status"] + (f": {row['error']}" if row["error"] else "")
        typer.echo(f"{cell.completer} · {task}: {known.status} on the board, {now} now")
        return (row["status"] == "ok") == (known.status == "ok")
    values = {name: sum(its["samples"]) / len(its["samples"]) for name, its in row["metrics"].items() if its["samples"]}
    for name, value in known.values.items():
        now = f"{values[name]:.6g}" if name in values else "nothing"
        typer.echo(f"{cell.completer} · {task} · {name}: {value:.6g} on the board, {now} now")
    return known.values.keys() == values.keys() and all(
        math.isclose(values[name], value, rel_tol=AGREEMENT, abs_tol=1e-9) for name, value in known.values.items()
    )
