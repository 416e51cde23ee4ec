"""`pcdbench leaderboard build` and `check` as a user runs them."""

import json
import sys
from functools import partial
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner

from pcdbench.cli import app

SUITE = """
dataset = { name = "tiny", options = { scenes = 4 } }
incompletenesses = ["slab"]
levels = [0.3]
completers = ["tiny_fill"]
tasks = ["tiny_gap"]
"""


@pytest.fixture
def run(tmp_path, tiny_plugins, monkeypatch):
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)

    def command(*arguments, code=0):
        monkeypatch.setattr(sys, "argv", ["pcdbench", *arguments])
        ended = CliRunner().invoke(app, arguments)
        assert ended.exit_code == code, (ended.stdout, ended.stderr, ended.exception)
        return ended

    return command


def another_updates(folder, *_):
    path = folder / "leaderboard.json"
    path.write_text(path.read_text().replace('"tiny_fill"', '"other_fill"'))
    return [], []


def test_a_suite_is_run_built_and_checked(run, tmp_path, monkeypatch):
    folder = tmp_path / "boards" / "tiny"
    folder.mkdir(parents=True)
    (folder / "suite.toml").write_text(SUITE)
    run("run", "boards/tiny/suite.toml", "--out", "runs/tiny", "--jobs", "1")
    built = run("leaderboard", "build", "runs/tiny", "-o", "boards/tiny")
    assert {"leaderboard.json", "README.md", "leaderboard.csv", "leaderboard.parquet"} <= {
        path.name for path in folder.iterdir()
    }
    assert "boards/tiny/leaderboard.json" in built.stdout.splitlines()
    assert "pcdbench run boards/tiny/suite.toml --out runs/tiny" in (folder / "README.md").read_text()
    assert "pcdbench leaderboard case boards/tiny" in (folder / "index.html").read_text()
    assert (folder / "suite.toml").read_text() == SUITE

    reports = ["--markdown", "out/summary.md", "--junit", "out/junit.xml", "--jobs", "1"]
    held = run("leaderboard", "check", "boards/tiny", *reports)
    assert held.stdout.splitlines()[-1].startswith("tiny holds: nothing got worse")
    assert "✅" in (tmp_path / "out" / "summary.md").read_text()

    before = (folder / "leaderboard.csv").read_text()
    assert "clouds of the page" not in built.stderr
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert "clouds of the page" in run("leaderboard", "build", "runs/tiny", "-o", "boards/tiny", "--update").stderr
    monkeypatch.delenv("FORCE_COLOR")
    assert (folder / "leaderboard.csv").read_text() == before
    assert [its["label"] for its in json.loads((folder / "leaderboard.json").read_text())["completers"]][
        -1
    ] == "tiny_fill"

    with monkeypatch.context() as patch:
        patch.setattr("pcdbench.leaderboard.case_clouds.clouds_of_page", partial(another_updates, folder))
        before = (folder / "leaderboard.json").read_text()
        late = run("leaderboard", "build", "runs/tiny", "-o", "boards/tiny", "--update", code=2)
        assert "boards/tiny was updated by another pcdbench meanwhile; give the same command again" in late.stderr
        assert (folder / "leaderboard.json").read_text() != before
        (folder / "leaderboard.json").write_text(before)

    path = folder / "leaderboard.json"
    content = json.loads(path.read_text())
    for cell in content["cells"]:
        if cell["completer"] == "tiny_fill":
            cell["results"]["tiny_gap"]["values"]["gap_m"] *= 0.9
    path.write_text(json.dumps(content))
    fell = run("leaderboard", "check", "boards/tiny", "--run", "runs/tiny", *reports[:4], code=1)
    assert fell.stdout.startswith("worse: gap_m (tiny_gap) of tiny_fill: worse by 11.")
    assert "❌" in (tmp_path / "out" / "summary.md").read_text()
    assert ElementTree.parse(tmp_path / "out" / "junit.xml").getroot().get("failures") == "1"
    both = run("leaderboard", "check", "boards/tiny", "--run", "runs/tiny", "--out", "kept", code=2)
    assert "--out is for the run that a check makes, and --run gives one; leave one of them out" in both.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["build", "nowhere", "-o", "board"], "nowhere is not a run"),
        (["build", "nowhere", "-o", "board", "--update"], "nowhere is not a run"),
        (["check", "nowhere"], "nowhere is not there; make it with: pcdbench leaderboard build RUN... -o nowhere"),
    ],
)
def test_mistakes_are_one_line(run, arguments, message):
    ended = run("leaderboard", *arguments, code=2)
    assert message in ended.stderr and ended.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["suite.toml", "--split", "few"], "--split is what the suite suite.toml says"),
        (["--completer", "tiny_fill"], "name a --completer and a --task"),
        (["nowhere.toml"], "nowhere.toml cannot be read"),
    ],
)
def test_a_run_is_asked_for_by_a_suite_or_by_options(run, tmp_path, arguments, message):
    (tmp_path / "suite.toml").write_text(SUITE)
    assert message in run("run", *arguments, code=2).stderr
