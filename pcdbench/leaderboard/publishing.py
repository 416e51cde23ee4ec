"""A board's folder: everything in it is written from the board, and nothing else in it is touched."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.board_figures import write_figures
from pcdbench.leaderboard.board_file import LEADERBOARD, write_board
from pcdbench.leaderboard.board_readme import board_readme
from pcdbench.leaderboard.board_table import write_tables
from pcdbench.leaderboard.page import board_page
from pcdbench.runner.store import write_text

if TYPE_CHECKING:
    from pcdbench.leaderboard.board import Board
    from pcdbench.leaderboard.case_clouds import CaseClouds

README = "README.md"
PAGE = "index.html"
SUITE = "suite.toml"
FIGURES = "figures"


def publish(board: Board, folder: Path, clouds: Sequence[CaseClouds] = ()) -> list[Path]:
    """Write `leaderboard.json`, `.csv`, `.parquet`, `README.md`, `index.html` and `figures/`.

    Equal boards with equal clouds give equal files.

    Args:
        clouds: of the cases that can be turned on the page.

    Raises:
        PcdbenchError: where the folder cannot be written.
    """
    page = board_page(board, clouds, case_command=f"pcdbench leaderboard case {shown_folder(board.name, folder)}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_board(board, folder / LEADERBOARD)
        write_tables(board, folder)
        figures = write_figures(board, folder / FIGURES)
        write_text(folder / README, board_readme(board, figures, build_commands(board.name, folder), folder))
        write_text(folder / PAGE, page)
    except OSError as error:
        raise PcdbenchError(f"{folder} cannot be written ({error.strerror}); give another -o") from error
    names = (LEADERBOARD, "leaderboard.csv", "leaderboard.parquet", README, PAGE, FIGURES)
    return [folder / name for name in names]


def shown_folder(name: str, folder: Path) -> str:
    """A board's folder as readers type it: as it was given, or by the board's name where it is of one machine alone."""
    return shlex.quote(name if folder.is_absolute() or ".." in folder.parts else folder.as_posix())


def build_commands(name: str, folder: Path) -> Sequence[str]:
    """The commands that measure and build a board again; a folder with a suite says what to measure."""
    shown = shown_folder(name, folder)
    if (folder / SUITE).is_file():
        suite, run = shown_folder(f"{name}/{SUITE}", folder / SUITE), shlex.quote(f"runs/{name}")
        return [f"pcdbench run {suite} --out {run}", f"pcdbench leaderboard build {run} -o {shown}"]
    return [f"pcdbench leaderboard build RUN... -o {shown}"]
