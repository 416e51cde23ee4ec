"""Boards updated with some completers: as if everything had been run at once, and only where all measures alike."""

from dataclasses import replace

import pytest
from runs_for_tests import full_row, store_run

from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.board_file import board_json, read_board, write_board
from pcdbench.leaderboard.building import board_of_runs
from pcdbench.leaderboard.updating import updated

SCENES = [f"room{number}" for number in range(7)]


def rows_of(completer, base, scenes=SCENES, **more):
    rows = []
    for number, scene in enumerate(scenes):
        for task, factor in (("task", 1.0), ("other", 3.0)):
            samples = [factor * base + number, factor * base + number + 0.5]
            rows.append(full_row(completer, samples, scene=scene, task=task, **more))
            rows[-1]["metrics"]["minor"] = rows[-1]["metrics"]["error_m"] | {"main": False, "unit": "1"}
    return rows


def board(tmp_path, name, *rows, **facts):
    return board_of_runs("b", [store_run(tmp_path / name, [row for its in rows for row in its], **facts)])


def test_it_is_the_board_of_all_the_runs(tmp_path):
    floor, a, b = rows_of("incomplete", 5.0), rows_of("a", 1.0), rows_of("b", 2.0)
    old = board(tmp_path, "old", floor, rows_of("a", 9.0, version="0"), b, time="2026-01-01")
    board(tmp_path, "new", floor, a, time="2026-01-02")
    whole = board_of_runs("b", [store_run(tmp_path / "kept", [*floor, *b], time="2026-01-01"), tmp_path / "new"])
    write_board(old, tmp_path / "board.json")
    found = updated(read_board(tmp_path / "board.json"), board_of_runs("b", [tmp_path / "new"]))
    assert [its.label for its in found.completers] == ["incomplete", "a", "b"]
    assert [its.version for its in found.completers] == ["1", "1", "1"]
    # Of the floor, measured in both runs, the older cost stays.
    runs = {its.completer: its.run for its in found.cells}
    assert runs == {"incomplete": 0, "a": 1, "b": 0}
    same = [replace(its, run=runs[its.completer]) for its in whole.cells]
    assert board_json(replace(whole, cells=tuple(same))) == board_json(found)
    ranks = {(its.completer, its.metric): its.rank for its in found.standings if its.task == "task"}
    assert ranks["a", "error_m"] == 1 and ranks["b", "error_m"] == 2 and ranks["a", "minor"] is None


def test_a_completer_may_come_to_it_and_cover_less(tmp_path):
    old = board(tmp_path, "old", rows_of("incomplete", 5.0), rows_of("a", 1.0))
    found = updated(old, board(tmp_path, "new", rows_of("incomplete", 5.0, SCENES[:3]), rows_of("c", 0.5, SCENES[:3])))
    assert {its.completer: its.cases for its in found.standings} == {"incomplete": 7, "a": 7, "c": 3}


def with_second(rows):
    for row in rows:
        row["metrics"]["second"] = row["metrics"]["minor"]
    return rows


def test_a_metric_that_only_completers_have_comes_to_it_as_in_one_board_of_all_runs(tmp_path):
    old = board(tmp_path, "old", rows_of("a", 1.0))
    found = updated(old, board(tmp_path, "new", with_second(rows_of("c", 2.0)), time="2026-01-02"))
    assert [metric.name for metric in found.task_of["task"].metrics] == ["error_m", "minor", "second"]
    assert board_json(found) == board_json(board_of_runs("b", [tmp_path / "old", tmp_path / "new"]))


def test_a_metric_that_references_have_on_one_side_alone_is_refused_as_merging_its_rows_is(tmp_path):
    less = board(tmp_path, "less", rows_of("incomplete", 5.0), rows_of("a", 1.0))
    more = board(tmp_path, "more", *(with_second(rows_of(*its)) for its in (("incomplete", 5.0), ("a", 1.0))))
    for old, new, where in ((less, more, "in the runs"), (more, less, "on the board")):
        with pytest.raises(PcdbenchError, match=rf"second \(other\) of the references is {where} alone; build the"):
            updated(old, new)
    with pytest.raises(PcdbenchError, match=r"do not agree on .* second has "):
        board_of_runs("b", [tmp_path / "less", tmp_path / "more"])


def test_what_is_measured_anew_is_measured_whole(tmp_path):
    old = board(tmp_path, "old", rows_of("incomplete", 5.0), rows_of("a", 1.0))
    for name, rows, count in (
        ("task", [row for row in rows_of("a", 0.5) if row["task"]["name"] == "task"], 7),
        ("scenes", rows_of("a", 0.5, SCENES[:3], version="2"), 8),
    ):
        with pytest.raises(PcdbenchError, match=f"the board b has {count} measurements of a that the runs have not"):
            updated(old, board(tmp_path, name, rows_of("incomplete", 5.0), rows))


def test_a_run_without_references_shows_nothing(tmp_path):
    floor = rows_of("incomplete", 5.0)
    old = board(tmp_path, "old", floor, rows_of("a", 1.0))
    failed = [row | {"status": "failed", "error": "E", "metrics": {}} for row in floor]
    of_one_task = [row for row in floor if row["task"]["name"] == "task"]
    for name, references in (("none", []), ("failed", failed), ("one", of_one_task)):
        with pytest.raises(
            PcdbenchError, match=r"no reference of the runs shows that they measure other \(holes, 30%\)"
        ):
            updated(old, board(tmp_path, name, references, rows_of("c", 1.0)))


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (rows_of("incomplete", 6.0), "do not measure as the board b does: .*incomplete"),
        (rows_of("a", 1.0, task_version="2"), "do not measure as the board b does: task"),
        (rows_of("a", 1.0, ["room9"]), "has no case room9 .holes, 30%, split test.; run its suite"),
        (rows_of("a", 1.0, level=0.5), "has no case room0"),
        ([row | {"task": row["task"] | {"name": "new"}} for row in rows_of("a", 1.0)[::2]], "has no task new"),
    ],
)
def test_what_measures_otherwise_is_refused(tmp_path, rows, told):
    old = board(tmp_path, "old", rows_of("incomplete", 5.0), rows_of("a", 1.0))
    with pytest.raises(PcdbenchError, match=told):
        updated(old, board(tmp_path, "new", rows))


def test_a_run_of_references_alone_and_one_of_another_split_are_refused(tmp_path):
    old = board(tmp_path, "old", rows_of("incomplete", 5.0), rows_of("a", 1.0))
    with pytest.raises(PcdbenchError, match="no completer to put on the board b"):
        updated(old, board(tmp_path, "floor", rows_of("incomplete", 5.0)))
    new = board(tmp_path, "new", rows_of("incomplete", 5.0), rows_of("c", 1.0))
    other = replace(new, data=tuple(replace(its, split="val") for its in new.data))
    with pytest.raises(PcdbenchError, match=r"has no case room0 \(holes, 30%, split val\)"):
        updated(old, other)


def test_runs_of_which_nothing_is_left_leave_the_board(tmp_path):
    found = board(tmp_path, "old", rows_of("incomplete", 5.0), rows_of("a", 9.0))
    for number in range(4):
        rows = rows_of("a", 1.0, version=str(number))
        found = updated(found, board(tmp_path, f"new{number}", rows_of("incomplete", 5.0), rows))
    assert len(found.runs) == 2
    assert {its.completer: its.run for its in found.cells} == {"incomplete": 0, "a": 1}
