"""The runs that a check makes: as much of a board's suite as the suite says is enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.board import Board
from pcdbench.leaderboard.gate import FEWEST_CASES
from pcdbench.leaderboard.publishing import SUITE
from pcdbench.plugins import did_you_mean
from pcdbench.runner.plan import ALL, Plan, Request, plan
from pcdbench.suite import Check, read_suite, requests


def check_plans(board: Board, folder: Path, dataset: str | None = None) -> list[Plan]:
    """What is to be run to check a board.

    Args:
        folder: of the board, with its `suite.toml`; the suite's table `check` says what is enough.
        dataset: `NAME:PATH`, instead of the suite's.

    Raises:
        PcdbenchError: where there is no suite, or it asks for what cannot be run, or for too few cases.
    """
    path = folder / SUITE
    if not path.is_file():
        raise PcdbenchError(f"{folder} has no {SUITE}, which says what to run; give a run of its cases by --run")
    suite = read_suite(path)
    asked = requests(suite, folder, dataset=dataset)
    _require_known(asked, board, suite.check, path)
    plans = []
    for request in asked:
        narrowed = _narrowed(request, board, suite.check)
        if narrowed.completers:
            plans.append(_of_scenes(plan(narrowed), suite.check.scenes))
    cases = {(planned.dataset.identity, cell.case) for planned in plans for cell in planned.cells}
    if plans and len(cases) < FEWEST_CASES:
        raise PcdbenchError(
            f"{path}: a check needs {FEWEST_CASES} cases, and this is of {len(cases)}; name more scenes or levels in "
            "the suite, or in its [check]"
        )
    return plans


def _require_known(asked: Sequence[Request], board: Board, check: Check, path: Path) -> None:
    """Raise where the check names what the suite has not: it would check less than it seems to."""
    for what, names in (
        ("completers", check.completers),
        ("tasks", check.tasks),
        ("incompletenesses", check.incompletenesses),
        ("levels", [f"{level:g}" for level in check.levels]),
    ):
        known = [name for request in asked for name in _names(request, board)[what]]
        strange = next((name for name in names if name not in known), None)
        if strange is not None:
            raise PcdbenchError(
                f"{path}: check.{what} has {strange!r}, which is not in the suite; "
                f"{did_you_mean(strange, dict.fromkeys(known))}"
            )


def _names(request: Request, board: Board) -> Mapping[str, Sequence[str]]:
    """What a request names; `all` is what is on the board."""
    return {
        "completers": _spelt_out(request.completers, [its.name for its in board.completers if not its.reference]),
        "tasks": _spelt_out(request.tasks, [its.name for its in board.tasks]),
        "incompletenesses": _spelt_out(request.incompletenesses, [its.name for its in board.incompletenesses]),
        "levels": [f"{level:g}" for level in request.levels],
    }


def _narrowed(request: Request, board: Board, check: Check) -> Request:
    """The request without what the check leaves out."""
    names = _names(request, board)
    completers = _chosen(names["completers"], check.completers)
    tasks = _chosen(names["tasks"], check.tasks)
    ways = _chosen(names["incompletenesses"], check.incompletenesses)
    kept = {*completers, *tasks, *ways, request.dataset.partition(":")[0]}
    return replace(
        request,
        completers=completers,
        tasks=tasks,
        incompletenesses=ways,
        levels=check.levels or request.levels,
        options=[text for text in request.options if text.partition(".")[0] in kept],
    )


def _spelt_out(names: Sequence[str], everything: Sequence[str]) -> list[str]:
    return list(dict.fromkeys(one for name in names for one in (everything if name == ALL else [name])))


def _chosen(names: Sequence[str], wanted: Sequence[str]) -> list[str]:
    return [name for name in names if not wanted or name in wanted]


def _of_scenes(planned: Plan, scenes: Sequence[str]) -> Plan:
    for scene in scenes:
        if scene not in planned.scenes:
            raise PcdbenchError(
                f"the check asks for scene {scene!r}, which split {planned.split} of {planned.dataset.name} has not; "
                f"{did_you_mean(scene, list(planned.scenes))}"
            )
    return replace(planned, scenes={scene: planned.scenes[scene] for scene in scenes}) if scenes else planned
