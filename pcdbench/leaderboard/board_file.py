"""`leaderboard.json`: a board as a file, a line an entry so that its history reads well, and how old ones are read."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from pcdbench.errors import PcdbenchError
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
    Comparison,
    Standing,
)
from pcdbench.leaderboard.statistics import Estimate
from pcdbench.runner.store import write_text

LEADERBOARD = "leaderboard.json"
SCHEMA_VERSION = 1
MIGRATIONS: Mapping[int, Callable[[dict[str, Any]], dict[str, Any]]] = {}
"""By the version that a file has: what makes the next version of it."""

_DESCRIBED = ("data", "incompletenesses", "tasks", "completers", "runs")
_MEASURED = ("cases", "cells", "standings", "comparisons")


def write_board(board: Board, path: Path) -> None:
    """Write a board; the same board gives the same bytes."""
    write_text(path, board_json(board))


def board_json(board: Board) -> str:
    """The text of `leaderboard.json`.

    An object with `schema_version`, `name` and a list for each other attribute of `Board`. Values are as in the
    board; an estimate is `[value, low, high]`, and what is not a number is null.
    """
    parts = [f'"schema_version": {SCHEMA_VERSION}', f'"name": {_line(board.name)}']
    for name in (*_DESCRIBED, *_MEASURED):
        lines = ",\n".join(_line(_plain(entry)) for entry in getattr(board, name))
        parts.append(f'"{name}": [\n{lines}\n]' if lines else f'"{name}": []')
    return "{\n" + ",\n".join(parts) + "\n}\n"


def read_board(path: Path) -> Board:
    """The board in a `leaderboard.json`, of this version of the schema or an older one.

    Args:
        path: the file, or the folder that it is in.

    Raises:
        PcdbenchError: where there is none, it is damaged, or a newer pcdbench wrote it.
    """
    path = path / LEADERBOARD if path.is_dir() else path
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        version = content["schema_version"]
    except FileNotFoundError:
        raise PcdbenchError(
            f"{path} is not there; make it with: pcdbench leaderboard build RUN... -o {path.parent}"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise PcdbenchError(f"{path} cannot be read ({error}); build the board again") from None
    if version > SCHEMA_VERSION:
        raise PcdbenchError(f"{path} was written by a newer pcdbench; update this one (pip install -U pcdbench)")
    try:
        while version < SCHEMA_VERSION:
            content = MIGRATIONS[version](content)
            version += 1
        return _board(content)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        told = f"{type(error).__name__}: {error}"
        raise PcdbenchError(f"{path} is damaged ({told}); build the board again") from None


def _board(content: Mapping[str, Any]) -> Board:
    return Board(
        name=content["name"],
        data=_each(BoardData, content["data"]),
        incompletenesses=_each(BoardIncompleteness, content["incompletenesses"]),
        tasks=tuple(BoardTask(**task | {"metrics": _each(BoardMetric, task["metrics"])}) for task in content["tasks"]),
        completers=_each(BoardCompleter, content["completers"]),
        runs=_each(BoardRun, content["runs"]),
        cases=_each(BoardCase, content["cases"]),
        cells=tuple(
            BoardCell(**cell | {"results": {name: _result(its) for name, its in cell["results"].items()}})
            for cell in content["cells"]
        ),
        standings=tuple(_standing(its) for its in content["standings"]),
        comparisons=tuple(
            Comparison(**its | {"difference": _estimate(its["difference"])}) for its in content["comparisons"]
        ),
    )


def _each(kind: Any, entries: Iterable[Mapping[str, Any]]) -> tuple[Any, ...]:
    return tuple(kind(**entry) for entry in entries)


def _result(entry: Mapping[str, Any]) -> BoardResult:
    return BoardResult(**{**entry, "samples": tuple(entry.get("samples", ()))})


def _standing(entry: Mapping[str, Any]) -> Standing:
    estimates = {name: _estimate(entry[name]) for name in ("median", "p90", "mean")}
    numbers = {name: math.nan if entry[name] is None else entry[name] for name in ("missing", "seconds", "memory_mb")}
    return Standing(**{**entry, **estimates, **numbers})


def _estimate(entry: list[float | None] | None) -> Estimate | None:
    return None if entry is None else Estimate(*(math.nan if value is None else value for value in entry))


def _plain(value: Any) -> Any:
    """A dataclass of the board as JSON values; a result leaves out what it has not."""
    if isinstance(value, Estimate):
        return [_rounded(number) for number in (value.value, value.low, value.high)]
    if isinstance(value, BoardResult):
        told = {field.name: getattr(value, field.name) for field in fields(value)}
        return {name: its for name, its in told.items() if its or name in ("key", "status")}
    if hasattr(value, "__dataclass_fields__"):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, float):
        return None if math.isnan(value) else value
    if isinstance(value, Mapping):
        return {name: _plain(its) for name, its in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(its) for its in value]
    return value


def _rounded(value: float) -> float | None:
    return None if math.isnan(value) else float(f"{value:.9g}")


def _line(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(", ", ": "))
