"""`pcdbench audit`: a task that measures passes, a blind one fails and is named."""

import json

from typer.testing import CliRunner

from pcdbench.cli import app
from pcdbench.cli.audit import _print_audits
from pcdbench.leaderboard.audit import Audit, Check

TINY = ["--dataset", "tiny", "--incompleteness", "slab", "--jobs", "1", "--option", "tiny.scenes=12"]


def audit(tmp_path, *arguments):
    return CliRunner().invoke(app, ["audit", *TINY, "--out", str(tmp_path / "run"), *arguments])


def test_a_task_that_measures_passes(tmp_path, tiny_plugins):
    ended = audit(tmp_path, "tiny_gap", "--option", "tiny.points=700", "--level", "0.3,0.5,0.7")
    assert ended.exit_code == 0, ended.stdout + ended.stderr
    assert ended.stdout.count("holds") == 5 and "does not hold" not in ended.stdout
    assert "12 scenes" in ended.stdout


def test_a_blind_task_fails_and_the_comparisons_are_named(tmp_path, tiny_plugins):
    ended = audit(tmp_path, "tiny_blind,tiny_gap", "--level", "0.3,0.5", "--format", "json")
    assert ended.exit_code == 1
    blind, gap = json.loads(ended.stdout)["audits"]
    assert not blind["passed"] and gap["passed"]
    assert [check["name"] for check in blind["checks"] if not check["holds"]] == [
        "resample beats incomplete 30%",
        "incomplete 30% beats 50%",
        "resample apart from incomplete 50%",
    ]
    assert "tiny_blind (slab): incomplete 30% beats 50%" in ended.stderr and "tiny_gap" not in ended.stderr


def test_without_a_second_sample_the_truth_is_the_ceiling(tmp_path, tiny_plugins):
    ended = audit(tmp_path, "tiny_gap", "--option", "tiny.dense=500")
    assert ended.exit_code == 0, ended.stdout + ended.stderr
    assert "No second sample of these scenes exists: the ceiling is the truth itself." in ended.stdout
    assert "skipped: resample on tiny_gap: the dense cloud of" in ended.stdout


def test_few_scenes_are_said_to_say_little(capsys):
    for scenes in (1, 2):
        _print_audits([Audit("t", "m", "m", "lower", "holes", scenes, "resample", (), ())], [])
    assert [line.strip() for line in capsys.readouterr().out.splitlines() if "little" in line] == [
        "1 scene says little; take a larger --split.",
        "2 scenes say little; take a larger --split.",
    ]


def test_what_plugins_say_is_no_markup(capsys):
    error = "no [bold] kernel in [/usr/lib/x.so] for :key:"
    nothing = Check("something is measured", False, None, error)
    row = {"status": "failed", "error": error, "scene": "s", "completer": {"name": "c"}, "task": {"name": "t"}}
    _print_audits([Audit("t", "", "", "", "holes", 0, "", (), (nothing,))], [row])
    assert capsys.readouterr().out.count(error) == 2
