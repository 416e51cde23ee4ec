"""The clouds of a board's cases, made again from what the board says of them, to be looked at side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from pcdbench.case import Case
from pcdbench.cloud import PointCloud
from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.board import Board, BoardCell
from pcdbench.leaderboard.summary import level_text
from pcdbench.plugins import Kind
from pcdbench.runner.completions import CompletionCache
from pcdbench.runner.execute import Executor, Failure
from pcdbench.runner.plan import Cell, case_seed
from pcdbench.runner.selection import Plugin, select_recorded
from pcdbench.viewing.shown import Shown, missing_in, shown_clouds

# Positions, colours, distances and marks are ten bytes a point, in base64; the page must stay a page.
PAGE_MEGABYTES = 10.0
POINTS_AT_MOST = 20_000
_CHARACTERS_A_POINT = 13.5
TRUE, INCOMPLETE = "true", "incomplete"


@dataclass(frozen=True)
class CaseClouds:
    """One case as it can be looked at.

    Attributes:
        case: index into `Board.cases`.
        labels: by cloud, the completer that completed it; None for the true and the incomplete cloud.
        shown: by cloud.
    """

    case: int
    title: str
    labels: tuple[str | None, ...]
    shown: tuple[Shown, ...]


class Remaking:
    """Makes cases and completions of a board again, by its own words: names, options, seeds, digests.

    Args:
        paths: by name of a data set, where it lies, for those that need to be told.
        anew: whether completions are made even where the cache has them.
    """

    def __init__(self, board: Board, paths: Mapping[str, str | None] | None = None, *, anew: bool = False) -> None:
        self.board = board
        self._paths = paths or {}
        self._cache = CompletionCache(limit_mb=0 if anew else None)
        self._executors: dict[int, Executor] = {}
        self._plugins: dict[tuple[Kind, str], Plugin] = {}

    @cached_property
    def _cells_of(self) -> Mapping[int, Sequence[BoardCell]]:
        found: dict[int, list[BoardCell]] = {}
        for cell in self.board.cells:
            found.setdefault(cell.case, []).append(cell)
        return found

    def cell(self, known: BoardCell) -> Cell:
        """The cell that this one of the board is, for the runner.

        Raises:
            PcdbenchError: where a plugin is not installed, or something that decides the outcome is not what it was.
        """
        its = self.board.cases[known.case]
        data = self.board.data[its.data]
        dataset = self._dataset(its.data)
        incompleteness = next(one for one in self.board.incompletenesses if one.name == its.incompleteness)
        completer = self.board.completer_of[known.completer]
        cell = Cell(
            dataset=dataset.identity,
            scene=its.scene,
            scene_digest=data.scenes[its.scene],
            draw=its.draw,
            incompleteness=self._plugin(
                "incompleteness", its.incompleteness, its.incompleteness, incompleteness.options
            ),
            level=its.level,
            seed=case_seed(its.seed, data.dataset, its.scene, its.incompleteness, its.draw),
            completer=self._plugin("completer", known.completer, completer.name, completer.options),
        )
        if not cell.key.startswith(known.key):
            raise PcdbenchError(
                f"{known.completer} on {its.scene} cannot be made again: a version, an option or weights are not what "
                f"they were on board {self.board.name}; install what it was made with (see its runs)"
            )
        return cell

    def case(self, known: BoardCell) -> Case:
        """The case of a cell.

        Raises:
            PcdbenchError: where it cannot be made again, or its scene is not what it was.
        """
        its = self.board.cases[known.case]
        cell = self.cell(known)
        dataset = self._dataset(its.data)
        if dataset.build().digest(its.scene) != cell.scene_digest:
            raise PcdbenchError(f"scene {its.scene} of {dataset.name} is not the one that board {self.board.name} saw")
        try:
            return self._executor(its.data).case(cell)
        except Failure as failure:
            raise PcdbenchError(f"{its.scene} cannot be made again: {failure.error}") from failure

    def completed(self, known: BoardCell, case: Case) -> PointCloud:
        """The completed cloud of a cell, from the cache or made again.

        Raises:
            PcdbenchError: where it cannot be made.
        """
        data = self.board.cases[known.case].data
        try:
            return self._executor(data).completion(self.cell(known), case)[0].cloud
        except Failure as failure:
            raise PcdbenchError(f"{known.completer} on {case.scene.name}: {failure.error}") from failure

    def rows(self, known: BoardCell, tasks: Sequence[str]) -> list[dict[str, Any]]:
        """The rows of a cell, measured again.

        Raises:
            PcdbenchError: where the cell cannot be made again.
        """
        its = self.board.cases[known.case]
        plugins = [self._plugin("task", name, name, self.board.task_of[name].options) for name in tasks]
        return self._executor(its.data).rows(self.cell(known), plugins)

    def clouds(self, case: int, points: int) -> tuple[CaseClouds, list[str]]:
        """The true, the incomplete and every completed cloud of a case, and a line for each that cannot be made.

        The references are left out, but the incomplete cloud: they are the truth, and as good as it.

        Args:
            points: of a cloud at most.

        Raises:
            PcdbenchError: where the case itself cannot be made.
        """
        cells = self._cells_of[case]
        made = self._any_case(cells)
        named: list[tuple[str | None, str, PointCloud]] = [
            (None, TRUE, made.scene.complete),
            (None, INCOMPLETE, made.cloud),
        ]
        problems = []
        for known in cells:
            if self.board.completer_of[known.completer].reference:
                continue
            try:
                named.append((known.completer, known.completer, self.completed(known, made)))
            except PcdbenchError as error:
                problems.append(str(error))
        marks = [None, None, *(missing_in(cloud, made.cloud) for _, _, cloud in named[2:])]
        shown = shown_clouds([(name, cloud) for _, name, cloud in named], marks, made.scene.complete, points)
        # What the incomplete cloud lacks is seen beside it; nothing was added to it.
        shown[1] = replace(shown[1], added=None, added_total=0, compared_with=None)
        its = self.board.cases[case]
        missing = level_text(its.level, math.nan if its.missing is None else its.missing)
        title = f"{its.scene}: {missing} missing ({its.incompleteness})"
        return CaseClouds(case, title, tuple(label for label, _, _ in named), tuple(shown)), problems

    def _any_case(self, cells: Sequence[BoardCell]) -> Case:
        """The case of these cells: each of them tells which it is, if its completer is here as it was."""
        problems = []
        for known in cells:
            try:
                return self.case(known)
            except PcdbenchError as error:
                problems.append(error)
        raise problems[0]

    def _dataset(self, number: int) -> Plugin:
        data = self.board.data[number]
        return select_recorded("dataset", data.dataset, data.options, path=self._paths.get(data.dataset))

    def _executor(self, number: int) -> Executor:
        if number not in self._executors:
            self._executors[number] = Executor(self._dataset(number), self._cache)
        return self._executors[number]

    def _plugin(self, kind: Kind, label: str, name: str, options: Mapping[str, Any]) -> Plugin:
        if (kind, label) not in self._plugins:
            self._plugins[kind, label] = select_recorded(kind, name, options)
        return self._plugins[kind, label]


def clouds_of_page(
    board: Board,
    scenes: int,
    paths: Mapping[str, str | None] | None = None,
    shown: Callable[[Sequence[int]], Iterable[int]] = iter,
) -> tuple[list[CaseClouds], list[str]]:
    """Clouds for a board's page: of so many scenes of each data set, each incompleteness and level once.

    All together are about `PAGE_MEGABYTES`: the more clouds there are, the fewer points each has.

    Args:
        paths: see `Remaking`.
        shown: goes through the cases one by one, and may show how far it is: completing takes minutes at worst.

    Returns:
        The clouds, and a line for whatever could not be made again: the page is right without them.
    """
    remaking, cases = Remaking(board, paths), list(shown_cases(board, scenes))
    panels = 2 + sum(not completer.reference for completer in board.completers)
    points = int(PAGE_MEGABYTES * 1e6 / _CHARACTERS_A_POINT / max(len(cases) * panels, 1))
    made, problems = [], []
    for case in shown(cases):
        try:
            its, lost = remaking.clouds(case, min(points, POINTS_AT_MOST))
        except PcdbenchError as error:
            problems.append(str(error))
            continue
        made.append(its)
        problems += lost
    return made, list(dict.fromkeys(problems))


def shown_cases(board: Board, scenes: int) -> Iterator[int]:
    """The first draw at every level of each incompleteness, of the first scenes where most was measured."""
    measured: dict[tuple[int, str], int] = {}
    for cell in board.cells:
        case = board.cases[cell.case]
        count = sum(result.status == "ok" for result in cell.results.values())
        measured[case.data, case.scene] = measured.get((case.data, case.scene), 0) + count
    chosen = {
        scene
        for data in range(len(board.data))
        for scene in sorted((its for its in measured if its[0] == data), key=lambda its: -measured[its])[:scenes]
    }
    seen = set()
    for number, case in enumerate(board.cases):
        place = (case.data, case.scene, case.incompleteness, case.level)
        if (case.data, case.scene) in chosen and place not in seen:
            seen.add(place)
            yield number
