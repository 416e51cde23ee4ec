"""Suites: what they ask for, and mistakes in them told in one line with its number."""

from pathlib import Path

import pytest

from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.board import Board, BoardCompleter, BoardIncompleteness, BoardTask
from pcdbench.leaderboard.board_file import read_board
from pcdbench.leaderboard.gate_run import check_plans
from pcdbench.plugins import registry
from pcdbench.runner.plan import Request, plan
from pcdbench.suite import read_suite, requests

ROOT = Path(__file__).parents[1]
LEAST = 'completers = ["tiny_fill"]\ntasks = ["tiny_gap"]\n'


@pytest.fixture
def suite(tmp_path):
    def write(text):
        (tmp_path / "suite.toml").write_text(text)
        return read_suite(tmp_path / "suite.toml")

    return write


def test_what_is_left_out_is_as_the_command_has_it(suite, tmp_path):
    assert requests(suite(LEAST), tmp_path) == [
        Request(["tiny_fill"], ["tiny_gap"], incompletenesses=["holes"], levels=[0.1, 0.3, 0.5], options=[])
    ]


def test_everything_that_can_be_said(suite, tmp_path):
    text = """
    dataset = { name = "tiny", options = { scenes = 2, color = false } }
    split = "few"
    incompletenesses = ["slab"]
    levels = [0.2]
    seeds = [0, 7]
    references = false
    completers = [
        "tiny_colorful",
        { name = "tiny_fill", options = { points = 9 } },
        { name = "tiny_fill", options = { points = 90 } },
    ]
    tasks = ["tiny_gap", { name = "tiny_wrong", options = { how = "nan" } }]
    """
    found = requests(suite(text), tmp_path)
    common = ["tiny.scenes=2", "tiny.color=False", "tiny_wrong.how=nan"]
    assert [(its.completers, its.seed, its.options) for its in found] == [
        (["tiny_colorful", "tiny_fill"], 0, [*common, "tiny_fill.points=9"]),
        (["tiny_fill"], 0, [*common, "tiny_fill.points=90"]),
        (["tiny_colorful", "tiny_fill"], 7, [*common, "tiny_fill.points=9"]),
        (["tiny_fill"], 7, [*common, "tiny_fill.points=90"]),
    ]
    assert {(its.dataset, its.split, tuple(its.levels), its.references) for its in found} == {
        ("tiny", "few", (0.2,), False)
    }


def test_what_is_there_twice_alike_is_run_once(suite, tmp_path):
    text = """
    seeds = [7, 7]
    completers = ["tiny_fill", { name = "tiny_fill", options = { points = 9 } }, "tiny_fill"]
    tasks = ["tiny_gap"]
    """
    found = requests(suite(text), tmp_path)
    assert [(its.completers, its.seed, its.options) for its in found] == [
        (["tiny_fill"], 7, []),
        (["tiny_fill"], 7, ["tiny_fill.points=9"]),
    ]


def test_a_suite_becomes_plans(suite, tmp_path, tiny_plugins):
    text = LEAST + 'dataset = {name = "tiny", options = {scenes = 2}}\nincompletenesses = ["slab"]\nlevels = [0.3]'
    (request,) = requests(suite(text), tmp_path)
    planned = plan(request)
    assert list(planned.scenes) == ["box0", "box1"] and planned.levels == (0.3,)


def test_paths_are_of_the_file_or_the_environment_or_the_command(suite, tmp_path, monkeypatch):
    read = suite(LEAST + 'dataset = "clouds:scans"')
    assert requests(read, tmp_path)[0].dataset == f"clouds:{tmp_path / 'scans'}"
    assert requests(read, tmp_path, dataset="clouds:/there")[0].dataset == "clouds:/there"
    read = suite(LEAST + 'dataset = { name = "clouds", path = "$SCANS_OF_TEST/a" }')
    with pytest.raises(
        PcdbenchError, match=r"at \$SCANS_OF_TEST/a, and that is not set; set it, or give --dataset clouds:"
    ):
        requests(read, tmp_path)
    monkeypatch.setenv("SCANS_OF_TEST", "/scans")
    assert requests(read, tmp_path)[0].dataset == "clouds:/scans/a"


def test_options_of_a_data_set_count_wherever_its_path_stands(suite, tmp_path):
    for text in (
        '{ name = "clouds:rooms", options = { points = 9 } }',
        '{ name = "clouds", path = "rooms", options = { points = 9 } }',
    ):
        read = suite(f"{LEAST}dataset = {text}")
        (request,) = requests(read, tmp_path)
        assert (request.dataset, request.options) == (f"clouds:{tmp_path / 'rooms'}", ["clouds.points=9"])
        assert requests(read, tmp_path, dataset="clouds:/there")[0].options == ["clouds.points=9"]
        with pytest.raises(PcdbenchError, match="has options of clouds, which --dataset indoor has no use for; give"):
            requests(read, tmp_path, dataset="indoor")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            LEAST + 'dataset = {name = "clouds:a", path = "b"}',
            "suite.toml, line 3: dataset: its path must be there once, not {'name': 'clouds:a'",
        ),
        (
            'tasks = ["a"]\ncompleters = [{name = "all", options = {x = 1}}]',
            "suite.toml, line 2: completers.0: options need the name of one plugin, not {'name': 'all'",
        ),
        (
            'completers = ["a"]\ntasks = [{name = "a", options = {x = 1}}, {name = "a", options = {x = 2}}]',
            "suite.toml, line 2: tasks: one with options must be there once, not",
        ),
        (LEAST + "levels = [0.1, 3.0]", "suite.toml, line 3: levels.1: input should be less than 1, not 3.0"),
        (LEAST + "\nlevel = [0.1]", "suite.toml, line 4: a suite has no 'level'; did you mean levels?"),
        (LEAST + "[check]\nscene = ['a']", "suite.toml, line 4: a suite has no 'check.scene'; did you mean scenes?"),
        (LEAST + "seeds = []", "suite.toml, line 3: seeds: list should have at least 1 item"),
        ('tasks = ["a"]', "suite.toml: it has no 'completers'; add it"),
        (LEAST + "split = 3", "suite.toml, line 3: split: input should be a valid string, not 3"),
        (LEAST + "split = \n", "suite.toml is not TOML: .*line 3"),
        (LEAST + 'dataset = {nam = "x"}', "suite.toml, line 3: it has no 'dataset.name'"),
        (LEAST + 'completers = ["b"]\n', "suite.toml is not TOML: .*line 3"),
        (
            'tasks = ["a"]\ncompleters = [{name = "a", options = {x = [[1]]}}]',
            "suite.toml, line 2: completers.0.options.x",
        ),
    ],
)
def test_a_mistake_is_one_line_with_its_number(suite, text, message):
    with pytest.raises(PcdbenchError, match=message) as error:
        suite(text)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_or_no_text(tmp_path):
    with pytest.raises(PcdbenchError, match="cannot be read"):
        read_suite(tmp_path / "suite.toml")
    (tmp_path / "suite.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(PcdbenchError, match="cannot be read"):
        read_suite(tmp_path / "suite.toml")


@pytest.mark.parametrize("path", sorted(ROOT.glob("leaderboards/*/suite.toml")), ids=lambda path: path.parent.name)
def test_the_boards_suites_ask_for_what_there_is(path):
    read = read_suite(path)
    for entry in read.tasks + read.completers + read.incompletenesses:
        assert entry.name == "all" or entry.name in {
            its.name for kind in ("task", "completer", "incompleteness") for its in registry().all(kind)
        }
    asked = requests(read, path.parent, dataset=None if read.dataset.path is None else "clouds:x")
    if asked[0].dataset == "indoor":
        planned = plan(asked[0])
        assert set(read.check.scenes) <= set(planned.scenes) and len(planned.scenes) == 30


def test_the_board_indoor_is_what_its_suite_measures_today():
    folder = ROOT / "leaderboards" / "indoor"
    planned = [plan(asked) for asked in requests(read_suite(folder / "suite.toml"), folder)]
    keys = {cell.row_key(task)[:16] for its in planned for cell in its.cells for task in its.tasks}
    board = read_board(folder)
    measured = [(cell.completer, task, its.key) for cell in board.cells for task, its in cell.results.items()]
    assert {(completer, task) for completer, task, key in measured if key not in keys} == set()
    assert len(measured) == len(keys)


def board_of(completers, tasks):
    return Board(
        "board",
        (),
        (BoardIncompleteness("slab", "1", {}),),
        tuple(BoardTask(name, "1", {}, ()) for name in tasks),
        tuple(BoardCompleter(name, name, "1", {}, reference=name == "incomplete") for name in completers),
        *((),) * 5,
    )


def test_a_check_runs_what_the_suite_says_is_enough_of_what_is_on_the_board(tmp_path, tiny_plugins):
    (tmp_path / "suite.toml").write_text("""
    dataset = "tiny"
    incompletenesses = ["slab"]
    completers = ["all", { name = "tiny_fill", options = { points = 7 } }]
    tasks = ["all"]
    [check]
    scenes = ["box2", "box1"]
    levels = [0.3, 0.5]
    tasks = ["tiny_gap"]
    """)
    board = board_of(["incomplete", "tiny_fill", "tiny_colorful"], ["tiny_gap", "tiny_color"])
    (planned,) = check_plans(board, tmp_path)
    methods = [its.name for its in planned.completers if not its.reference]
    assert methods == ["tiny_fill", "tiny_colorful"]
    assert [its.options.get("points") for its in planned.completers if its.name == "tiny_fill"] == [7]
    assert ([its.name for its in planned.tasks], list(planned.scenes), planned.levels) == (
        ["tiny_gap"],
        ["box2", "box1"],
        (0.3, 0.5),
    )
    with pytest.raises(PcdbenchError, match="which says what to run; give a run of its cases by --run"):
        check_plans(board, tmp_path / "nowhere")
    text = (tmp_path / "suite.toml").read_text()
    for has, asks, message in (
        ('["tiny_gap"]', '["tiny_gap", "tiny_gab"]', "check.tasks has 'tiny_gab', which is not in the suite; did you "),
        ("[0.3, 0.5]", "[0.3]", "a check needs 4 cases, and this is of 2; name more scenes or levels"),
        ("[0.3, 0.5]", "[0.3, 0.4]", r"check.levels has '0.4', which is not in the suite; did you mean 0"),
        ('tasks = ["tiny_gap', "completers = ['tiny_fil']\ntasks = [\"tiny_gap", "has 'tiny_fil', .* mean tiny_fill"),
        ("[check]", "[check]\nincompletenesses = ['holes']", "check.incompletenesses has 'holes', .*; there is slab"),
    ):
        (tmp_path / "suite.toml").write_text(text.replace(has, asks))
        with pytest.raises(PcdbenchError, match=message):
            check_plans(board, tmp_path)
    text = text.replace("box1", "box11")
    (tmp_path / "suite.toml").write_text(text)
    with pytest.raises(PcdbenchError, match="scene 'box11', which split few of tiny has not; did you mean box1"):
        check_plans(board, tmp_path)
