"""The runs that a check makes: as much of a board's suite as the suite says is enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.board import Board
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
        PcdbenchError: where there is no suite, or it asks for what cannot be run.
    """
    path = folder / SUITE
    if not path.is_file():
        raise PcdbenchError(f"{folder} has no {SUITE}, which says what to run; give a run of its cases by --run")
    suite = read_suite(path)
    plans = []
    for request in requests(suite, folder, dataset=dataset):
        narrowed = _narrowed(request, board, suite.check)
        if narrowed.completers:
            plans.append(_of_scenes(plan(narrowed), suite.check.scenes))
    return plans


def _narrowed(request: Request, board: Board, check: Check) -> Request:
    """The request without what the check leaves out; `all` is what is on the board."""
    on_board = [its.name for its in board.completers if not its.reference]
    completers = _chosen(request.completers, on_board, check.completers)
    tasks = _chosen(request.tasks, [its.name for its in board.tasks], check.tasks)
    ways = _chosen(request.incompletenesses, [its.name for its in board.incompletenesses], check.incompletenesses)
    kept = {*completers, *tasks, *ways, request.dataset.partition(":")[0]}
    return replace(
        request,
        completers=completers,
        tasks=tasks,
        incompletenesses=ways,
        levels=check.levels or request.levels,
        options=[text for text in request.options if text.partition(".")[0] in kept],
    )


def _chosen(names: Sequence[str], everything: Sequence[str], wanted: Sequence[str]) -> list[str]:
    spelt_out = [one for name in names for one in (everything if name == ALL else [name])]
    return [name for name in dict.fromkeys(spelt_out) if not wanted or name in wanted]


def _of_scenes(planned: Plan, scenes: Sequence[str]) -> Plan:
    for scene in scenes:
        if scene not in planned.scenes:
            raise PcdbenchError(
                f"the check asks for scene {scene!r}, which split {planned.split} of {planned.dataset.name} has not; "
                f"{did_you_mean(scene, list(planned.scenes))}"
            )
    return replace(planned, scenes={scene: planned.scenes[scene] for scene in scenes}) if scenes else planned
