"""A board of which some completers were measured anew, or came to it: the others stay as they are."""

from __future__ import annotations

from dataclasses import replace

from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.board import Board, BoardTask
from pcdbench.leaderboard.building import comparisons_of, in_order, rankings_of
from pcdbench.leaderboard.gate import case_key, changed_protocols, paired, reference_changes
from pcdbench.leaderboard.saw_test import seen_in_training
from pcdbench.leaderboard.summary import level_text


def updated(board: Board, fresh: Board) -> Board:
    """The board with the fresh one's completers, each in the place of all that the board had under its name.

    References are not taken over: measured again beside the completers, they show that both boards measure alike.
    Of the others their cells and standings stay; ranks and comparisons are made anew. Metrics that the board does not
    have come to it.

    Args:
        fresh: of runs of some or all of the board's cases and tasks.

    Raises:
        PcdbenchError: where it measures something else, or otherwise, than the board.
    """
    number = {case_key(board, case): at for at, case in enumerate(board.cases)}
    strange = next((case for case in fresh.cases if case_key(fresh, case) not in number), None)
    if strange is not None:
        where = (
            f"{strange.scene} ({strange.incompleteness}, {level_text(strange.level)}, "
            f"split {fresh.data[strange.data].split})"
        )
        raise PcdbenchError(f"the board {board.name} has no case {where}; run its suite, or build a board of its own")
    for task in fresh.tasks:
        if task.name not in board.task_of:
            raise PcdbenchError(
                f"the board {board.name} has no task {task.name}; leave it out, or build the board anew"
            )
    found = list(changed_protocols(board, fresh))
    if not found:
        _refuse_other_metrics(board, fresh)
        found = list(reference_changes(board, paired(board, fresh), set()))
    changed = next((finding for finding in found if finding.kind == "changed"), None)
    if changed is not None:
        raise PcdbenchError(f"the runs do not measure as the board {board.name} does: {changed.told}")

    _require_references(board, fresh)
    ours = {
        its.label: replace(its, saw_test=seen_in_training(its.card, board.data))
        for its in fresh.completers
        if not its.reference
    }
    if not ours:
        raise PcdbenchError(f"the runs have no completer to put on the board {board.name}, only references")
    names = {its.name for its in ours.values()}
    _refuse_less(board, fresh, names)
    kept = {its.label: its for its in board.completers if its.name not in names}
    completers = tuple(sorted([*kept.values(), *ours.values()], key=lambda its: (not its.reference, its.label)))
    position = {its.label: at for at, its in enumerate(completers)}
    case_of = [number[case_key(fresh, case)] for case in fresh.cases]
    taken = (
        replace(cell, case=case_of[cell.case], run=len(board.runs) + cell.run)
        for cell in fresh.cells
        if cell.completer in ours
    )
    cells = sorted(
        [*(cell for cell in board.cells if cell.completer in kept), *taken],
        key=lambda cell: (cell.case, position[cell.completer]),
    )
    runs = (*board.runs, *fresh.runs)
    used = sorted({cell.run for cell in cells})
    number_of = {run: at for at, run in enumerate(used)}
    cells = [replace(cell, run=number_of[cell.run]) for cell in cells]
    places = [(its.dataset, its.split) for its in board.data]
    data_of = [places.index((its.dataset, its.split)) for its in fresh.data]
    tasks = _tasks(board, fresh)
    rankings = rankings_of(board.data, board.cases, cells, completers, tasks)
    main = {(task.name, metric.name) for task in tasks for metric in task.metrics if metric.main}
    standings = []
    for standing in [
        *(its for its in board.standings if its.completer in kept),
        *(replace(its, data=data_of[its.data]) for its in fresh.standings if its.completer in ours),
    ]:
        table = (standing.data, standing.incompleteness, standing.level, standing.task)
        ranks = rankings[table].ranks if (standing.task, standing.metric) in main and table in rankings else {}
        standings.append(replace(standing, rank=ranks.get(standing.completer)))
    return replace(
        board,
        tasks=tasks,
        completers=completers,
        runs=tuple(runs[at] for at in used),
        cells=tuple(cells),
        standings=tuple(
            standing
            for at in range(len(board.data))
            for standing in in_order((its for its in standings if its.data == at), completers, tasks)
        ),
        comparisons=comparisons_of(rankings),
    )


def _refuse_other_metrics(board: Board, fresh: Board) -> None:
    """Raise where the same cases of references have a metric on one of the boards alone: their rows do not merge."""
    measured = [
        (task, old.values, pair.new.results[task].values)
        for label, its in paired(board, fresh).items()
        if board.completer_of[label].reference
        for pair in its
        for task, old in pair.old.results.items()
        if task in pair.new.results and old.status == pair.new.results[task].status == "ok"
    ]
    had, has = ({(task, name) for task, *values in measured for name in values[at]} for at in (0, 1))
    if had != has:
        task, name = min(had ^ has)
        raise PcdbenchError(
            f"the runs do not measure as the board {board.name} does: {name} ({task}) of the references is "
            f"{'in the runs' if (task, name) in has else 'on the board'} alone; build the board anew"
        )


def _require_references(board: Board, fresh: Board) -> None:
    """Raise where no reference shows that a table is measured as on the board, which has references there."""
    shown = {
        (pair.case.data, pair.case.incompleteness, pair.case.level, task)
        for label, its in paired(board, fresh).items()
        if board.completer_of[label].reference
        for pair in its
        for task, old in pair.old.results.items()
        if task in pair.new.results and old.status == pair.new.results[task].status == "ok"
    }
    number = {(its.dataset, its.split): at for at, its in enumerate(board.data)}
    of_references, of_others = (
        {
            (number[data.dataset, data.split], case.incompleteness, case.level, task)
            for cell in its.cells
            if its.completer_of[cell.completer].reference is reference
            for case in [its.cases[cell.case]]
            for data in [its.data[case.data]]
            for task, result in cell.results.items()
            if result.status == "ok"
        }
        for its, reference in ((board, True), (fresh, False))
    )
    unshown = (of_others & of_references) - shown
    if unshown:
        _, incompleteness, level, task = min(unshown)
        raise PcdbenchError(
            f"no reference of the runs shows that they measure {task} ({incompleteness}, {level_text(level)}) as the "
            f"board {board.name} does; run the references too"
        )


def _tasks(board: Board, fresh: Board) -> tuple[BoardTask, ...]:
    """The board's tasks with the metrics of both."""
    merged = []
    for task in board.tasks:
        its = fresh.task_of.get(task.name, task)
        known = {metric.name for metric in task.metrics}
        metrics = [*task.metrics, *(metric for metric in its.metrics if metric.name not in known)]
        merged.append(replace(task, metrics=tuple(sorted(metrics, key=lambda one: not one.main))))
    return tuple(merged)


def _refuse_less(board: Board, fresh: Board, names: set[str]) -> None:
    """Raise where one of these completers has measurements on the board that the fresh one has none in place of."""
    has, had = (
        {
            (its.completer_of[cell.completer].name, case_key(its, its.cases[cell.case]), task)
            for cell in its.cells
            for task in cell.results
            if its.completer_of[cell.completer].name in names
        }
        for its in (fresh, board)
    )
    lost = had - has
    if lost:
        name, case, task = min(lost, key=str)
        names_of_lost = ", ".join(sorted({its[0] for its in lost}))
        raise PcdbenchError(
            f"the board {board.name} has {len(lost)} measurements of {names_of_lost} that the runs have not, {task} of "
            f"{name} in {case[2]} for one; run them too, or build a board of its own"
        )
