"""What is written of a board: files that can be read back, by us and by others, and a page that names cannot break."""

import csv
import json
import math
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from boards_for_tests import made_board
from runs_for_tests import full_row, store_run

from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.board_figures import _figures
from pcdbench.leaderboard.board_file import SCHEMA_VERSION, board_json, read_board, write_board
from pcdbench.leaderboard.board_readme import board_readme
from pcdbench.leaderboard.building import board_of_runs
from pcdbench.leaderboard.page_data import _samples
from pcdbench.leaderboard.publishing import build_commands, publish
from pcdbench.leaderboard.statistics import Estimate

OLD = Path(__file__).parent / "old_boards"
HOSTILE = "a|b<script>*x*`\n#1"


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    values = {"ground_truth": 0.0, "good": 1.0, HOSTILE: 2.0, "incomplete": 5.0}
    rows = [
        full_row(
            name,
            [value * (1 + 0.1 * number) * (1 + level)],
            scene=f"room{number}",
            level=level,
            incompleteness=way,
            seconds=value + 0.1,
        )
        for name, value in values.items()
        for number in range(8)
        for level in (0.1, 0.3)
        for way in ("holes", "walk")
    ]
    rows += [full_row("broken", scene="room0", status="failed", error="a <b> c")]
    folder = store_run(tmp_path_factory.mktemp("run"), rows, cards={"good": {"trained_on": [{"dataset": "rooms"}]}})
    return board_of_runs("rooms board", [folder])


@pytest.fixture(scope="module")
def published(board, tmp_path_factory):
    folder = tmp_path_factory.mktemp("board")
    publish(board, folder)
    return folder


def test_a_board_is_read_as_it_was_written(board, published):
    again = read_board(published)
    assert board_json(again) == board_json(board) == (published / "leaderboard.json").read_text()
    assert (again.cases, again.cells, again.completers, again.data) == (
        board.cases,
        board.cells,
        board.completers,
        board.data,
    )
    content = json.loads((published / "leaderboard.json").read_text())
    assert content["schema_version"] == SCHEMA_VERSION


def test_the_same_board_gives_the_same_files(board, published, tmp_path):
    publish(board, tmp_path)
    names = [path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file()]
    assert {"README.md", "leaderboard.csv", "leaderboard.parquet", "leaderboard.json"} <= {name.name for name in names}
    for name in names:
        assert (tmp_path / name).read_bytes() == (published / name).read_bytes(), name


@pytest.mark.parametrize(
    ("folder", "shown"),
    [
        ("board", "board"),
        ("up/my boards/b", "'up/my boards/b'"),
        ("../b", "'rooms board'"),
        ("/somebody/s/own", "'rooms board'"),
    ],
)
def test_the_commands_of_a_board_can_be_typed(folder, shown):
    assert build_commands("rooms board", Path(folder)) == [f"pcdbench leaderboard build RUN... -o {shown}"]


def test_boards_of_old_versions_are_read():
    files = sorted(OLD.glob("*.json"))
    assert {json.loads(path.read_text())["schema_version"] for path in files} == set(range(1, SCHEMA_VERSION + 1))
    for path in files:
        board = read_board(path)
        assert [its.label for its in board.completers] == ["incomplete", "a", "net"]
        assert board.completer_of["net"].card == {"trained_on": [{"dataset": "rooms", "split": "train"}]}
        of = {its.completer: its for its in board.standings}
        assert (of["a"].median.value, of["a"].rank, of["net"].failed) == (4.25, 1, 1)
        assert board.cells[0].results["task"].samples and board.runs[0].calibration_seconds == 1.0


def test_each_version_is_made_the_next_one(monkeypatch):
    def renamed(content):
        assert content["schema_version"] == 1
        return content | {"schema_version": 2, "name": content["name"] + " of version 2"}

    def renamed_again(content):
        return content | {"schema_version": 3, "name": content["name"] + " and 3"}

    monkeypatch.setattr("pcdbench.leaderboard.board_file.SCHEMA_VERSION", 3)
    monkeypatch.setattr("pcdbench.leaderboard.board_file.MIGRATIONS", {1: renamed, 2: renamed_again})
    assert read_board(OLD / "version_1.json").name == "rooms of version 2 and 3"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "cannot be read"),
        ("[]", "cannot be read"),
        ('{"schema_version": 99}', "written by a newer pcdbench"),
        (f'{{"schema_version": {SCHEMA_VERSION}}}', "is damaged"),
        (f'{{"schema_version": {SCHEMA_VERSION}, "name": "x", "data": [{{"what": 1}}]}}', "is damaged"),
    ],
)
def test_a_damaged_board_is_one_line(tmp_path, text, message):
    (tmp_path / "leaderboard.json").write_text(text)
    with pytest.raises(PcdbenchError, match=message):
        read_board(tmp_path)
    with pytest.raises(PcdbenchError, match="is not there; make it with"):
        read_board(tmp_path / "nowhere.json")


def test_tables_have_exactly_these_columns(board, published):
    columns = [
        "dataset",
        "split",
        "incompleteness",
        "level",
        "completer",
        "task",
        "metric",
        "unit",
        "cases",
        "failed",
        "median",
        "median_low",
        "median_high",
        "p90",
        "mean",
        "mean_low",
        "mean_high",
    ]
    with (published / "leaderboard.csv").open(newline="") as stream:
        lines = list(csv.DictReader(stream))
    parquet = pd.read_parquet(published / "leaderboard.parquet")
    assert list(lines[0]) == list(parquet.columns) == columns
    assert len(lines) == len(parquet) == len(board.standings) == 4 * 2 * 2 + 1
    for line, (_, its) in zip(lines, parquet.iterrows(), strict=True):
        assert line["completer"] == its["completer"] and float(line["level"]) == its["level"]
        assert float(line["median"] or "nan") == pytest.approx(its["median"], rel=1e-8, nan_ok=True)
    (broken,) = [line for line in lines if line["completer"] == "broken"]
    assert (broken["cases"], broken["failed"], broken["mean"]) == ("0", "1", "")
    (good,) = [
        line for line in lines if (line["completer"], line["incompleteness"], line["level"]) == ("good", "walk", "0.3")
    ]
    values = [1.3 * (1 + 0.1 * number) for number in range(8)]
    assert float(good["mean"]) == pytest.approx(sum(values) / 8)
    assert float(good["mean_low"]) < float(good["mean"]) < float(good["mean_high"])


def test_the_page_shows_best_references_ranks_costs_flags_and_failures(published):
    page = (published / "README.md").read_text()
    table = page.partition("## 30% missing, `holes`")[2].partition("\n## ")[0]
    lines = [line for line in table.splitlines() if line.startswith("|")][2:]
    names = [re.split(r"(?<!\\)\|", line)[1].strip() for line in lines]
    assert names[0] == "*ground_truth* (the truth)" and names[-1] == "*incomplete* (the floor)"
    assert names[1] == "good †" and names[2].startswith("a\\|b&lt;script&gt;")
    good, bad = (re.split(r"(?<!\\)\|", line)[2].strip() for line in lines[1:3])
    assert re.fullmatch(r"\*\*1\.755\*\* \[1\.\d+, \d\.\d+\] \\#1", good) and bad.endswith("\\#2")
    assert re.split(r"(?<!\\)\|", lines[1])[4:6] == [" 1.1 ", " 2 "]
    assert "good † was trained on 8 of 8 scenes of rooms test" in page
    assert "1 failed: broken on task: a &lt;b&gt; c" in page
    assert "<script>" not in page
    for link in re.findall(r"!\[[^]]*\]\(([^)]+)\)", page):
        assert (published / link).is_file()


def test_metrics_and_splits_cannot_break_the_tables(tmp_path):
    rows = [full_row("a", [1.0], scene=f"room{number}", metric="|x| <b>") for number in range(2)]
    for row in rows:
        row["metrics"]["|x| <b>"]["unit"] = "a|b"
        row["task"]["options"] = {"scales_m": [2, 1], "how": "<b>"}
    board = board_of_runs("b", [store_run(tmp_path / "run", rows, split="one|two")])
    text = board_readme(board, {}, [], tmp_path)
    assert r"task: mean \|x\| &lt;b&gt; (a\|b) ↓" in text and r"rooms one\|two, holes" in text and "<b>" not in text
    assert "<summary>task, version 1 (scales_m=[2, 1], how=&lt;b&gt;)</summary>" in text
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    assert [line.replace("\\|", "").count("|") for line in lines] == [6] * 3 + [9] * 3


def test_a_split_may_be_called_like_a_path(tmp_path):
    rows = [full_row("größe", [1.0], scene=f"room{number}") for number in range(2)]
    runs = [store_run(tmp_path / name, rows, split=split) for name, split in (("a", "area/1"), ("b", "area 1"))]
    publish(board_of_runs("b", runs), tmp_path / "board")
    assert len(list((tmp_path / "board").rglob("*_by_level.svg"))) == 2
    assert "größe" in (tmp_path / "board" / "leaderboard.csv").read_text(encoding="utf-8")


def test_samples_beyond_number_are_left_out_of_the_page():
    few, many = {(0, 0): [1.0, 2.0]}, {(0, 0): [0.0] * 65_536}
    packed = _samples({0: few, 1: many}, (1, 1), 2)
    assert packed[0] is not None and packed[1] is None


def test_figures_are_svg_with_every_completer(published):
    names = {path.name for path in (published / "figures").iterdir()}
    assert names == {"by_level.svg", "distribution_task.svg", "time.svg"}
    for path in (published / "figures").iterdir():
        text = "".join(ElementTree.parse(path).getroot().itertext())
        assert "good" in text and "incomplete" in text and "holes" in text and "walk" in text
        assert path.stat().st_size < 300_000


def test_figures_draw_the_boards_intervals_also_those_that_end_at_zero():
    estimates = {
        "a": Estimate(0.05, 0.0, 0.12),
        "b": Estimate(-0.05, -0.12, 0.0),
        "incomplete": Estimate(1.0, math.nan, math.nan),
    }
    board = made_board(["a", "b"], incompletenesses=["holes"], levels=[0.3], tasks=["chamfer"])
    shown = [its for its in board.standings if its.metric == "chd" and its.completer in estimates]
    board = replace(board, standings=tuple(replace(its, median=estimates[its.completer]) for its in shown))
    drawn = {name: _interval_ends(figure) for name, _, figure in _figures(board)}
    ends = {"a": pytest.approx((0.0, 0.12)), "b": pytest.approx((-0.12, 0.0))}
    assert drawn["by_level"] == ends | {"incomplete": (1.0, 1.0)}
    assert drawn["time"] == ends, "where references are lines without an interval"


def _interval_ends(figure):
    """By completer, the lower and upper end of the only error bar that it has in the first panel."""
    found = {}
    for its in figure.axes[0].containers:
        (bars,) = its.lines[2]
        (segment,) = bars.get_segments()
        found[its.get_label()] = tuple(segment[:, 1])
    return found


def test_a_folder_that_cannot_be_written_is_one_line(board, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(PcdbenchError, match="cannot be written"):
        publish(board, tmp_path / "file")


def test_numbers_that_are_none_stay_none(board, tmp_path):
    write_board(board, tmp_path / "leaderboard.json")
    (broken,) = [its for its in read_board(tmp_path).standings if its.completer == "broken"]
    assert broken.mean is None and math.isnan(broken.seconds)


def test_a_board_with_a_task_that_measured_nothing_can_be_read_back(tmp_path):
    rows = [full_row(name, [1.0], scene=f"room{number}") for name in ("a", "b") for number in range(3)]
    rows += [
        full_row("a", scene=f"room{number}", task="idle", status="skipped", error="no boxes") for number in range(3)
    ]
    board = board_of_runs("b", [store_run(tmp_path / "run", rows)])
    write_board(board, tmp_path / "leaderboard.json")
    assert board_json(read_board(tmp_path / "leaderboard.json")) == board_json(board)
