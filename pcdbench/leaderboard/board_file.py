"""`leaderboard.json`: a board as a file, a line an entry so that its history reads well, and how old ones are read."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import orjson
from pydantic import TypeAdapter, ValidationError

from pcdbench.errors import PcdbenchError, first_problem, told
from pcdbench.leaderboard.board import Board, BoardCell, BoardCompleter, BoardData, BoardResult, Comparison, Standing
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
        line = _cell_line if name == "cells" else _line
        lines = ",\n".join(line(_plain(entry)) for entry in getattr(board, name))
        parts.append(f'"{name}": [\n{lines}\n]' if lines else f'"{name}": []')
    return "{\n" + ",\n".join(parts) + "\n}\n"


def read_board(path: Path) -> Board:
    """The board in a `leaderboard.json`, of this version of the schema or an older one.

    Args:
        path: the file, or the folder that it is in.

    Raises:
        PcdbenchError: where there is none, it is damaged, or a newer pcdbench wrote it.
    """
    folder = path.parent if path.suffix == ".json" else path
    try:
        path = path / LEADERBOARD if path.is_dir() else path
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_no_number, parse_float=_finite)
        version = content["schema_version"]
        if not isinstance(version, int) or version < min(MIGRATIONS, default=SCHEMA_VERSION):
            raise ValueError(f"there never was a schema_version {version!r}")
    except FileNotFoundError:
        raise PcdbenchError(
            f"{path} is not there; make it with: pcdbench leaderboard build RUN... -o {folder}"
        ) from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise PcdbenchError(f"{path} cannot be read ({error}); build the board again") from None
    if version > SCHEMA_VERSION:
        raise PcdbenchError(f"{path} was written by a newer pcdbench; update this one (pip install -U pcdbench)")
    try:
        while version < SCHEMA_VERSION:
            content = MIGRATIONS[version](content)
            version += 1
        board: Board = TypeAdapter(Board).validate_python(_with_estimates(content))
        _require_whole(board)
        return board
    except ValidationError as error:
        raise PcdbenchError(f"{path} is damaged ({first_problem(error)}); build the board again") from None
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise PcdbenchError(f"{path} is damaged ({told(error)}); build the board again") from None


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is not JSON")


def _finite(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _no_number(text)


def _with_estimates(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content with estimates, and what is not a number, as the board has them."""
    return {
        **content,
        "standings": [_standing(its) for its in content["standings"]],
        "comparisons": [its | {"difference": _estimate(its["difference"])} for its in content["comparisons"]],
    }


def _standing(entry: Mapping[str, Any]) -> dict[str, Any]:
    estimates = {name: _estimate(entry[name]) for name in ("median", "p90", "mean")}
    numbers = {name: math.nan if entry[name] is None else entry[name] for name in ("missing", "seconds", "memory_mb")}
    return {**entry, **estimates, **numbers}


def _estimate(entry: list[float | None] | None) -> dict[str, float] | None:
    if entry is None:
        return None
    value, low, high = (math.nan if its is None else its for its in entry)
    return {"value": value, "low": low, "high": high}


def _require_whole(board: Board) -> None:
    """Raise ValueError where the board speaks of what it does not have."""
    metrics = {task.name: {metric.name for metric in task.metrics} for task in board.tasks}
    ways = {its.name for its in board.incompletenesses}

    def require(there: bool, what: str) -> None:
        if not there:
            raise ValueError(f"it has no {what!r}")

    for case in board.cases:
        require(0 <= case.data < len(board.data) and case.scene in board.data[case.data].scenes, f"scene {case.scene}")
        require(case.incompleteness in ways, f"incompleteness {case.incompleteness}")
    for cell in board.cells:
        require(0 <= cell.case < len(board.cases), f"case {cell.case}")
        require(0 <= cell.run < len(board.runs), f"run {cell.run}")
        require(cell.completer in board.completer_of, f"completer {cell.completer}")
        for task, result in cell.results.items():
            require(task in metrics and result.values.keys() <= metrics[task], f"task {task} of these metrics")
    tables: list[Standing | Comparison] = [*board.standings, *board.comparisons]
    for table in tables:
        require(0 <= table.data < len(board.data) and table.incompleteness in ways, f"table {table.incompleteness}")
        require(table.task in metrics, f"task {table.task}")
    for standing in board.standings:
        require(standing.completer in board.completer_of, f"completer {standing.completer}")
        # A table in which nothing could be measured has no metric.
        require(not standing.metric or standing.metric in metrics[standing.task], f"metric {standing.metric}")


def _plain(value: Any) -> Any:
    """A dataclass of the board as JSON values; results leave out what they have not, others what hardly any has."""
    if isinstance(value, Estimate):
        return [_rounded(number) for number in (value.value, value.low, value.high)]
    if isinstance(value, BoardResult):
        kept = {field.name: getattr(value, field.name) for field in fields(value)}
        return {name: its for name, its in kept.items() if its or name in ("key", "status")}
    if hasattr(value, "__dataclass_fields__"):
        kept = {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
        if isinstance(value, BoardCell) and not value.cached:
            del kept["cached"]
        if isinstance(value, BoardCompleter) and not value.foreknew:
            del kept["foreknew"]
        if isinstance(value, BoardData) and not value.environments:
            del kept["environments"]
        return kept
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


def _cell_line(value: Any) -> str:
    """Likewise, ten times as fast and without spaces: cells are nearly all of a large board."""
    return orjson.dumps(value).decode()
