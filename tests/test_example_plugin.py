"""The example plugin, installed into an environment of its own and used through the command line."""

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pcdbench.scene import Scene

EXAMPLE = Path(__file__).parents[1] / "examples" / "pcdbench-example"


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the example: building leaves files behind."""
    ignored = shutil.ignore_patterns("build", "*.egg-info")
    return shutil.copytree(EXAMPLE, tmp_path_factory.mktemp("example") / "source", ignore=ignored)


@pytest.fixture(scope="module")
def python(example: Path, wheel: Path, install_fresh: Callable[..., Path]) -> Path:
    """The interpreter of a fresh environment that holds pcdbench and the example."""
    return install_fresh(example.parent / "env", wheel, example)


def run(command: list) -> str:
    """What the command prints; its errors in the failure."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, capture_output=True, text=True, cwd="/", env=environment)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_it_is_found_beside_our_own(python: Path) -> None:
    listed = run([python, "-m", "pcdbench", "list"])
    assert "not loaded" not in listed
    for name in ("midpoints", "coverage"):
        (line,) = (line for line in listed.splitlines() if line.startswith(f"  {name} "))
        assert "pcdbench-example 1.0.0" in line
    assert "  plane_fitting " in listed
    shown = run([python, "-m", "pcdbench", "show", "midpoints"])
    assert "midpoints.neighbors=8" in shown and "pcdbench's example plugin" in shown


def test_it_runs_on_a_folder_of_scans(python: Path, room: Scene, tmp_path: Path) -> None:
    scans, out = tmp_path / "scans", tmp_path / "run"
    scans.mkdir()
    room.dense.select(np.arange(3000)).write(scans / "room.ply")
    arguments = "--completer midpoints --task coverage --level 0.3"
    options = "--option midpoints.neighbors=4 --option coverage.reach_m=0.2"
    run(
        [
            python,
            "-m",
            "pcdbench",
            "run",
            "--dataset",
            f"clouds:{scans}",
            "--out",
            out,
            *f"{arguments} {options}".split(),
        ]
    )
    rows = [json.loads(line) for line in next(out.rglob("*.jsonl")).read_text().splitlines()]
    (mine,) = (row for row in rows if row["completer"]["name"] == "midpoints")
    (floor,) = (row for row in rows if row["completer"]["name"] == "incomplete")
    assert mine["status"] == floor["status"] == "ok"
    assert mine["completer"]["options"] == {"neighbors": 4, "gap": 2.0}
    covered = [row["metrics"]["covered"]["samples"][0] for row in (mine, floor)]
    assert all(0.7 < share < 1.0 for share in covered) and covered[0] != covered[1]
    assert mine["points"]["completed"] > floor["points"]["completed"] == 2100


def test_its_own_tests_pass_there(python: Path, example: Path) -> None:
    assert "2 passed" in run([python, "-m", "pytest", "-p", "no:cacheprovider", example / "tests"])
