"""Boards from runs: in any order, of what fits together only, with nothing lost."""

import itertools
import json
import re

import pytest
from runs_for_tests import full_row, store_run

from pcdbench.errors import PcdbenchError, RunWarning
from pcdbench.leaderboard.board_file import board_json, read_board, write_board
from pcdbench.leaderboard.board_readme import board_readme
from pcdbench.leaderboard.building import board_of_runs
from pcdbench.leaderboard.page_data import page_payload
from pcdbench.leaderboard.render import markdown, summary_tables
from pcdbench.leaderboard.results import read_results
from pcdbench.leaderboard.summary import summarize

SCENES = [f"room{number}" for number in range(7)]


def rows_of(completer, base, **more):
    return [
        full_row(completer, [base + number, base + number + 0.5], scene=scene, **more)
        for number, scene in enumerate(SCENES)
    ]


def test_runs_merge_to_the_same_board_in_any_order(tmp_path):
    a, floor = rows_of("a", 1.0), rows_of("incomplete", 5.0)
    again = [row | {"time": "2026-02-02T00:00:00Z", "host": "other"} for row in a[2:5]]
    again[0] = again[0] | {"metrics": {"error_m": again[0]["metrics"]["error_m"] | {"samples": [3.00001, 3.5]}}}
    folders = [
        store_run(tmp_path / "one", a[:4] + floor, time="2026-01-03"),
        store_run(tmp_path / "two", a[4:], time="2026-01-02"),
        store_run(tmp_path / "three", again, time="2026-01-04"),
    ]
    texts = {board_json(board_of_runs("b", order)) for order in itertools.permutations(folders)}
    assert len(texts) == 1
    board = board_of_runs("b", [tmp_path])
    assert texts == {board_json(board)}, "a folder of runs is all of them"
    assert board_json(board_of_runs("b", [folders[0], folders[0], *folders])) == texts.pop()
    assert [(its.completer, its.cases, its.rank) for its in board.standings] == [("incomplete", 7, None), ("a", 7, 1)]
    (cell,) = [its for its in board.cells if its.completer == "a" and board.cases[its.case].scene == "room2"]
    assert cell.results["task"].samples == (3.00001, 3.5), "of two rows that agree, the newest"
    assert cell.results["task"].values == {"error_m": 3.250005}


def test_a_cell_costs_what_was_measured_last(tmp_path):
    """Measuring the costs of a board again, on an idle machine, takes a run of one quick task."""
    rows = [full_row("a", [1.0], task=task, seconds=9.0) for task in ("one", "other")]
    again = full_row("a", [1.0], task="one", seconds=2.0, time="2026-02-02T00:00:00Z")
    cached = full_row("a", [1.0], task="another", seconds=9.0, time="2026-03-03T00:00:00Z")
    cached["completing"]["cached"] = True
    folders = [
        store_run(tmp_path / "busy", rows, calibration=3.0),
        store_run(tmp_path / "idle", [again, cached], calibration=1.0, time="2026-02-02"),
    ]
    for order in itertools.permutations(folders):
        board = board_of_runs("b", order)
        (cell,) = board.cells
        assert cell.seconds == 2.0 and board.runs[cell.run].calibration_seconds == 1.0
        assert set(cell.results) == {"one", "other", "another"}
    assert summarize([cached, again, *rows])["seconds"].eq(2.0).all()


def test_a_cell_is_of_the_machine_that_measured_it(tmp_path):
    here, there = full_row("a", [1.0], scene="room0"), full_row("a", [2.0], scene="room1") | {"host": "there"}
    folder = store_run(tmp_path / "run", [here, there], calibration=1.0, cpu="X")
    facts = json.loads((folder / "run.json").read_text())
    elsewhere = {"there": {"time": "2026-02-02", "calibration_seconds": 3.0, "machine": {"cpu": "Y"}}}
    (folder / "run.json").write_text(json.dumps(facts | {"host": "h", "elsewhere": elsewhere}))
    board = board_of_runs("b", [folder])
    ran = {board.cases[cell.case].scene: board.runs[cell.run] for cell in board.cells}
    assert {scene: (run.processor, run.calibration_seconds) for scene, run in ran.items()} == {
        "room0": ("X", 1.0),
        "room1": ("Y", 3.0),
    }


def test_what_is_there_twice_must_agree(tmp_path):
    one = store_run(tmp_path / "one", [full_row("a", [1.0])])
    two = store_run(tmp_path / "two", [full_row("a", [1.02])])
    with pytest.raises(PcdbenchError) as error:
        board_of_runs("b", [one, two])
    said = str(error.value)
    assert f"{one} and {two} do not agree on task of a in room0 (holes, 30%): error_m is 1 there, 1.02 here" in said
    for status in ("failed", "timeout"):
        store_run(tmp_path / "two", [full_row("a", status=status, error="it broke")])
        with pytest.raises(PcdbenchError, match="ok there, failed here"):
            board_of_runs("b", [one, two])
        store_run(tmp_path / "one", [full_row("a", status="failed", error="it broke otherwise")])
        assert len(board_of_runs("b", [one, two]).cells) == 1
        store_run(tmp_path / "one", [full_row("a", [1.0])])
    store_run(tmp_path / "two", [full_row("a", [1.0, 2.0])])
    with pytest.raises(PcdbenchError, match="1 samples there, 2 here"):
        board_of_runs("b", [one, two])


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"dataset_version": "2"}, "one has data set rooms at version 1, .*two at version 2"),
        ({"scene_digest": "d" * 20}, "scene room0 of data set rooms at digest room0, .* at digest dddd"),
        ({"task_version": "2"}, "task task at version 1, .*two at version 2"),
        ({"direction": "higher"}, "metric error_m of task task at the main metric, lower is better, .*two"),
    ],
)
def test_versions_do_not_mix(tmp_path, more, message):
    one = store_run(tmp_path / "one", [full_row("a", [1.0])])
    two = store_run(tmp_path / "two", [full_row("b", [1.0], **more)])
    with pytest.raises(PcdbenchError, match=message):
        board_of_runs("b", [one, two])


def test_two_states_of_a_completers_code_do_not_mix(tmp_path):
    one = store_run(tmp_path / "one", rows_of("a", 1.0), code="1111")
    more = [full_row("a", [1.0], scene=f"room{number}", task="other") for number in range(7)]
    with pytest.raises(PcdbenchError, match=r"one has completer a version 1 at code 1111, .*two at code 2222"):
        board_of_runs("b", [one, store_run(tmp_path / "two", more, code="2222")])
    assert len(board_of_runs("b", [one, store_run(tmp_path / "two", more, code="1111")]).tasks) == 2
    other = [full_row("a", [1.0], scene=f"room{number}", options={"k": 2}) for number in range(7)]
    with pytest.raises(PcdbenchError, match="their numbers do not mix"):
        board_of_runs("b", [one, store_run(tmp_path / "three", other, code="2222")])
    floors = [store_run(tmp_path / f"f{code}", rows_of("incomplete", 1.0), code=code) for code in "12"]
    assert len(board_of_runs("b", [one, *floors]).completers) == 2


def test_the_best_is_best_over_as_many_cases_as_any(tmp_path):
    rows = [*rows_of("plain", 5.0), *rows_of("lucky", 1.0)[:3]]
    run = store_run(tmp_path / "run", [*rows, full_row("lucky", scene="room6", status="failed", error="too hard")])
    readme = board_readme(board_of_runs("b", [run]), {}, ["build"], tmp_path)
    lines = {line.split(" | ")[0].strip("| "): line for line in readme.splitlines() if line.startswith("| ")}
    assert "**" in lines["plain"] and "cases)" not in lines["plain"]
    assert "**" not in lines["lucky"] and "(3 of 7 cases)" in lines["lucky"]
    shown = markdown(summary_tables(summarize(json.loads(line) for line in (run / "rows.jsonl").open())))
    assert "**plain**" in shown and "**lucky**" not in shown


def test_a_run_that_is_not_finished_is_told(tmp_path):
    run = store_run(tmp_path / "run", rows_of("a", 1.0), planned=9)
    for read in (lambda: board_of_runs("b", [run]), lambda: read_results(run)):
        with pytest.warns(
            RunWarning, match=r"run has 7 of its 9 rows: it is not finished; its command \(in run.json\)"
        ):
            read()
    store_run(run, rows_of("a", 1.0), planned=7)
    assert len(read_results(run)) and board_of_runs("b", [run]).cells


def test_splits_stand_side_by_side(tmp_path):
    store_run(tmp_path / "one", rows_of("a", 1.0), split="test")
    store_run(tmp_path / "two", rows_of("a", 1.0), split="small")
    board = board_of_runs("b", [tmp_path])
    assert [its.split for its in board.data] == ["small", "test"]
    assert [(its.data, its.cases) for its in board.standings] == [(0, 7), (1, 7)]


def test_runs_of_a_suites_seeds_are_found_beside_others(tmp_path):
    store_run(tmp_path / "one", rows_of("a", 1.0), split="test")
    store_run(tmp_path / "suite" / "1", rows_of("a", 1.0), split="small")
    store_run(tmp_path / "one" / "kept", rows_of("a", 9.0), split="earlier")
    assert [its.split for its in board_of_runs("b", [tmp_path]).data] == ["small", "test"]


def test_a_completer_with_other_options_or_weights_is_another_one(tmp_path):
    rows = rows_of("a", 1.0, options={"distance": 1, "same": 0}) + rows_of("a", 2.0, options={"distance": 2, "same": 0})
    rows += rows_of("net", 1.0, weights="1234567890") + rows_of("net", 1.0, weights="abcdefghij", version="2")
    board = board_of_runs("b", [store_run(tmp_path, rows)])
    assert [its.label for its in board.completers] == [
        "a (distance=1)",
        "a (distance=2)",
        "net (version 1, weights 12345678)",
        "net (version 2, weights abcdefgh)",
    ]
    assert [its.mean.value for its in board.standings][:2] == [4.25, 5.25]


def test_failed_cases_are_counted_and_cost_the_rank(tmp_path):
    fails = rows_of("fails", 0.9)
    fails[5:] = [full_row("fails", scene=scene, status="timeout", error="too long") for scene in SCENES[5:]]
    rows = rows_of("a", 1.0) + fails + rows_of("incomplete", 50.0)
    board = board_of_runs("b", [store_run(tmp_path, rows)])
    of = {its.completer: its for its in board.standings}
    assert (of["fails"].cases, of["fails"].failed, of["a"].failed) == (5, 2, 0)
    assert of["fails"].mean.value < of["a"].mean.value, "of what it measured"
    (comparison,) = board.comparisons
    assert (comparison.first, comparison.second) == ("a", "fails") and comparison.difference.value < 0
    (cell,) = [its for its in board.cells if its.completer == "fails" and board.cases[its.case].scene == "room6"]
    assert (cell.results["task"].status, cell.results["task"].error) == ("timeout", "too long")


@pytest.mark.parametrize(
    ("entry", "seen"),
    [
        ({"dataset": "rooms"}, 7),
        ({"dataset": "rooms", "split": "test"}, 7),
        ({"dataset": "rooms", "split": "train"}, 0),
        ({"dataset": "rooms", "scenes": ["room0", "room3", "room"]}, 2),
        ({"dataset": "other", "split": "test"}, 0),
    ],
)
def test_a_completer_that_saw_the_test_scenes_is_flagged(tmp_path, entry, seen):
    folder = store_run(tmp_path, rows_of("net", 1.0) + rows_of("a", 1.0), cards={"net": {"trained_on": [entry]}})
    of = board_of_runs("b", [folder]).completer_of
    assert of["a"].saw_test == "" and of["a"].card is None
    assert of["net"].saw_test == (f"{seen} of 7 scenes of rooms test" if seen else "")


def test_a_completer_that_gave_back_what_was_taken_away_is_told_on_the_board(tmp_path):
    rows = [row | ({"foreknown": 0.875} if row["scene"] == "room3" else {}) for row in rows_of("knows", 1.0)]
    board = board_of_runs("b", [store_run(tmp_path, rows + rows_of("a", 1.0))])
    told = "1 of 7 completed clouds hold points that were taken away, to the last bit (at most 88% of them)"
    assert board.completer_of["knows"].foreknew.startswith(told) and not board.completer_of["a"].foreknew
    assert f"\n- knows: {told}" in board_readme(board, {}, [], tmp_path)
    assert told in json.dumps(page_payload(board)["completers"])
    write_board(board, tmp_path / "leaderboard.json")
    assert read_board(tmp_path).completers == board.completers
    assert board_json(board).count("foreknew") == 1, "what hardly any has is not in the file of the others"


def test_scenes_of_a_trained_environment_and_of_an_overlapping_split_are_seen():
    from pcdbench.leaderboard.board import BoardData
    from pcdbench.leaderboard.saw_test import seen_in_training

    scenes = {f"env{number:03d}_crop0": "d" for number in range(30)}
    data = BoardData("indoor", "1", {}, "test-small", scenes)

    def seen(**entry):
        return seen_in_training({"trained_on": [{"dataset": "indoor", **entry}]}, [data])

    assert seen(scenes=["env003", "env02"]) == "1 of 30 scenes of indoor test-small"
    assert seen(split="") == seen(split="test-small", scenes=[]) == seen() == seen(split="test")
    assert seen(split="test") == "30 of 30 scenes of indoor test-small"
    assert seen(split="train") == seen(split="val") == seen(split="nonsense") == ""


def test_ranks_are_over_environments(tmp_path):
    """Two completers that differ in twelve crops alike: of one room apiece that is shown, of three rooms it is not."""

    def board(parts):
        rows = [
            row | {"dataset": row["dataset"] | ({"environment": f"place{number % parts}"} if parts else {})}
            for name, base in (("a", 1.0), ("b", 2.0))
            for number in range(12)
            for row in [full_row(name, [base + 0.01 * number], scene=f"room{number:02d}")]
        ]
        return board_of_runs("b", [store_run(tmp_path / str(parts), rows)])

    alone, of_three, of_six = board(0), board(3), board(6)
    assert [its.rank for its in alone.standings] == [its.rank for its in of_six.standings] == [1, 2]
    assert [its.rank for its in of_three.standings] == [1, 1]
    assert all((its.scenes, its.cases) == (12, 12) for its in of_three.standings)
    assert of_three.data[0].environments == {f"room{number:02d}": f"place{number % 3}" for number in range(12)}
    write_board(of_three, tmp_path / "leaderboard.json")
    assert read_board(tmp_path).data == of_three.data
    assert "environments" not in board_json(alone), "scenes that are environments of their own need no word"


def test_what_is_no_run_is_said(tmp_path):
    with pytest.raises(PcdbenchError, match="is not a run"):
        board_of_runs("b", [tmp_path])
    with pytest.raises(PcdbenchError, match="has no rows yet"):
        board_of_runs("b", [store_run(tmp_path, [])])


def test_keys_are_those_of_the_rows(tmp_path):
    row = full_row("a", [1.0])
    board = board_of_runs("b", [store_run(tmp_path, [row])])
    assert row["key"].startswith(board.cells[0].results["task"].key) and row["cell"].startswith(board.cells[0].key)
    assert re.fullmatch("[0-9a-f]{16}", board.cells[0].key)
