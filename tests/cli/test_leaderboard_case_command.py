"""`pcdbench leaderboard case`: a number of a built board leads back to the same number, and to its clouds."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pcdbench.cli import app
from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.board_file import read_board
from pcdbench.leaderboard.case_clouds import Remaking


@pytest.fixture
def command(tmp_path, tiny_plugins, monkeypatch):
    """A function that runs a command in a folder where a board has been built."""
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)

    def command(*arguments, code=0):
        monkeypatch.setattr(sys, "argv", ["pcdbench", *arguments])
        ended = CliRunner().invoke(app, arguments)
        assert ended.exit_code == code, (ended.output, ended.stderr, ended.exception)
        return ended

    tiny = ("--dataset", "tiny", "--incompleteness", "slab", "--level", "0.3", "--jobs", "1", "--out", "run")
    command("run", "--completer", "tiny_fill", "--task", "tiny_gap", *tiny)
    command("leaderboard", "build", "run", "-o", "board")
    return command


def test_a_key_leads_to_its_numbers_and_clouds(command):
    board = read_board(Path("board"))
    page = Path("board/index.html").read_text()
    assert page.count('<template id="clouds-') == 1, "one scene, one way, one level"
    cell = next(cell for cell in board.cells if cell.completer == "tiny_fill")
    row = cell.results["tiny_gap"]
    value = next(iter(row.values.values()))
    ended = command("leaderboard", "case", "board", row.key)
    assert f"{value:.6g} on the board, {value:.6g} now" in ended.output
    shown = Path("case.html").read_text()
    assert [shown.count(f"<strong>{name}</strong>") for name in ("true", "incomplete", "tiny_fill")] == [1, 1, 1]
    assert f"{board.cases[cell.case].scene}: 30% missing (slab)" in shown
    assert command("leaderboard", "case", "board", cell.key[:8]).output == ended.output
    for kept in Path("cache/completions").glob("*/*.npz"):
        with np.load(kept) as completion:
            np.savez(kept, **(dict(completion) | {"points": completion["points"] + 1.0}))
    assert command("leaderboard", "case", "board", row.key).output == ended.output, "it is not the cache that is asked"
    for key, told in [("12", "too short"), ("f" * 16, "no key of board board begins")]:
        refused = command("leaderboard", "case", "board", key, code=2).stderr
        assert told in refused and refused.count("\n") == 1

    changed = json.loads(Path("board/leaderboard.json").read_text())
    its = next(its for its in changed["cells"] if its["completer"] == "tiny_fill" and its["key"] == cell.key)
    metric = next(iter(row.values))
    its["results"]["tiny_gap"]["values"][metric] = value * 1.01
    Path("board/leaderboard.json").write_text(json.dumps(changed))
    told = command("leaderboard", "case", "board", row.key, code=1).output
    assert f"{value * 1.01:.6g} on the board, {value:.6g} now" in told

    its["key"] = "0" * 16
    Path("board/leaderboard.json").write_text(json.dumps(changed))
    refused = command("leaderboard", "case", "board", row.key, code=2).stderr
    assert "tiny_fill" in refused and "cannot be made again" in refused and refused.count("\n") == 1


def test_a_board_can_be_built_without_clouds_and_where_its_data_are_gone(command, monkeypatch):
    command("leaderboard", "build", "run", "-o", "board", "--cases", "0")
    assert "<template" not in Path("board/index.html").read_text()
    monkeypatch.setattr("pcdbench.leaderboard.case_clouds.Remaking.clouds", gone)
    ended = command("leaderboard", "build", "run", "-o", "board")
    assert "without clouds: the disk is elsewhere" in ended.stderr
    assert "<template" not in Path("board/index.html").read_text()


def test_cells_that_are_in_two_splits_are_one(command):
    shutil.copytree("run", "other")
    facts = json.loads(Path("run/run.json").read_text())
    facts["configuration"]["split"] = "of which it is a part"
    Path("other/run.json").write_text(json.dumps(facts))
    command("leaderboard", "build", "run", "other", "-o", "board")
    keys = [cell.key for cell in read_board(Path("board")).cells if cell.completer == "tiny_fill"]
    key = next(key for key in keys if keys.count(key) == 2)
    assert "on the board" in command("leaderboard", "case", "board", key).output


def test_clouds_do_not_hang_on_a_completer_that_is_gone(command, monkeypatch):
    board = read_board(Path("board"))
    first = board.cells[0].completer
    cell_of = Remaking.cell

    def cell(self, known):
        if known.completer == first:
            raise PcdbenchError(f"no completer is called {first!r}")
        return cell_of(self, known)

    monkeypatch.setattr(Remaking, "cell", cell)
    kept = next(cell for cell in board.cells if cell.completer == "tiny_fill")
    command("leaderboard", "case", "board", kept.key)
    assert "<strong>tiny_fill</strong>" in Path("case.html").read_text()


def gone(*_):
    raise PcdbenchError("the disk is elsewhere")
