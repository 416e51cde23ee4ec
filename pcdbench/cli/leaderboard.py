"""`pcdbench leaderboard`: boards from runs, and the check that holds changes to them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pcdbench.cli import leaderboard_case
from pcdbench.cli.bar import with_bar

if TYPE_CHECKING:
    from pcdbench.leaderboard.board import Board

app = typer.Typer(no_args_is_help=True, help="Build leaderboards from runs, and check changes against them.")


@app.callback()
def _leaderboard() -> None:
    """Build leaderboards from runs, and check changes against them."""


@app.command("build")
def build(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs, or folders that hold some.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The board's folder; its name is the board's.")],
    cases: Annotated[
        int,
        typer.Option(help="Scenes of each data set whose clouds the page holds, at every level; 0 for none.", min=0),
    ] = 1,
    update: Annotated[
        bool, typer.Option("--update", help="Put the runs' completers into the existing board; keep the others.")
    ] = False,
) -> None:
    """Merge runs into a leaderboard: leaderboard.json, README.md, index.html, figures, leaderboard.csv and .parquet.

    The runs may be of any machines, in any order. A cell that is in two runs must agree; runs of different versions
    of data, tasks or incompletenesses do not mix. The page's clouds are completed again where they are not in the
    cache; those that cannot be are named and left out.
    """
    from pcdbench.errors import PcdbenchError
    from pcdbench.leaderboard.building import board_of_runs
    from pcdbench.leaderboard.case_clouds import clouds_of_page
    from pcdbench.leaderboard.merging import data_paths
    from pcdbench.leaderboard.publishing import publish

    board, held = board_of_runs(out.resolve().name, runs), None
    if update:
        from pcdbench.leaderboard.board_file import read_board
        from pcdbench.leaderboard.updating import updated

        held = read_board(out)
        board = updated(held, board)
    clouds, problems = clouds_of_page(board, cases, data_paths(runs), partial(with_bar, what="clouds of the page"))
    for problem in problems:
        typer.echo(f"pcdbench: without clouds: {problem}", err=True)
    if held is not None and read_board(out) != held:
        raise PcdbenchError(f"{out} was updated by another pcdbench meanwhile; give the same command again")
    for path in publish(board, out, clouds):
        typer.echo(str(path))


app.command("case")(leaderboard_case.case)


@app.command("check")
def check(
    board: Annotated[Path, typer.Argument(help="The folder of a board.")],
    run: Annotated[
        list[Path] | None, typer.Option(help="A run to compare, repeatable (unless given: the board's suite is run).")
    ] = None,
    dataset: Annotated[str | None, typer.Option(help="NAME:PATH: where the data of the board lie here.")] = None,
    jobs: Annotated[int | None, typer.Option(help="Worker processes (unless given: one for each core).")] = None,
    out: Annotated[Path | None, typer.Option(help="Keep the run in this folder; it must be new.")] = None,
    markdown: Annotated[Path | None, typer.Option(help="Write the verdict here, as Markdown.")] = None,
    junit: Annotated[Path | None, typer.Option(help="Write the verdict here, as JUnit XML.")] = None,
) -> None:
    """Check whether anything got worse than on a committed leaderboard.

    Prints what got worse, better, slower or is measured otherwise. Exit code 1 on a regression.
    """
    import tempfile

    from pcdbench.leaderboard.board_file import read_board
    from pcdbench.leaderboard.building import board_of_runs
    from pcdbench.leaderboard.gate import check as checked
    from pcdbench.leaderboard.gate_report import verdict_junit, verdict_markdown, verdict_text

    committed = read_board(board)
    if run:
        _refuse_beside_run({"--dataset": dataset, "--jobs": jobs, "--out": out})
        fresh = board_of_runs(committed.name, run)
    else:
        with tempfile.TemporaryDirectory(prefix="pcdbench-check-") as scratch:
            folder = Path(scratch) / "runs" if out is None else out
            _run_again(committed, board, dataset, jobs, folder)
            fresh = board_of_runs(committed.name, [folder])
    verdict = checked(committed, fresh)
    for path, text in ((markdown, verdict_markdown), (junit, verdict_junit)):
        if path is not None:
            _write(path, text(verdict))
    typer.echo(verdict_text(verdict), nl=False)
    if not verdict.holds:
        raise typer.Exit(1)


def _refuse_beside_run(given: Mapping[str, object]) -> None:
    from pcdbench.errors import PcdbenchError

    for name, value in given.items():
        if value is not None:
            raise PcdbenchError(f"{name} is for the run that a check makes, and --run gives one; leave one of them out")


def _run_again(committed: Board, board: Path, dataset: str | None, jobs: int | None, folder: Path) -> None:
    """Run what the board's suite says is enough, each plan in a folder of its own, with nothing from the cache."""
    from pcdbench.errors import PcdbenchError
    from pcdbench.leaderboard.gate_run import check_plans
    from pcdbench.runner.completions import LIMIT_VARIABLE
    from pcdbench.runner.run import carry_out, local_processes

    if folder.exists():
        raise PcdbenchError(f"{folder} is there already, and a check measures anew; give another --out")
    before = os.environ.get(LIMIT_VARIABLE)
    os.environ[LIMIT_VARIABLE] = "0"
    try:
        for number, planned in enumerate(check_plans(committed, board, dataset), start=1):
            carry_out(planned, folder / str(number), local_processes(jobs))
    finally:
        os.environ.pop(LIMIT_VARIABLE)
        if before is not None:
            os.environ[LIMIT_VARIABLE] = before


def _write(path: Path, text: str) -> None:
    from pcdbench.errors import PcdbenchError

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise PcdbenchError(f"{path} cannot be written ({error.strerror}); give another file") from error
