"""`pcdbench doctor` tells what is installed, and finds whatever is missing, broken, deadly or silent."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from pcdbench import __version__
from pcdbench.doctor.checks import CHECKS, outcome
from pcdbench.doctor.examination import findings
from pcdbench.doctor.installation import folder_sizes_mb, modules_of, normal_name

ROOT = Path(__file__).parents[2]
QUICK = ("numpy", "scipy", "filelock")


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Puts a module of this source in front of the installed one, for processes started by the test."""

    def hide(module: str, source: str) -> None:
        (tmp_path / f"{module}.py").write_text(source)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    return hide


def test_every_self_test_is_of_a_declared_dependency() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    names = {normal_name(Requirement(text).name) for text in declared}
    assert set(CHECKS) - {"cache folder"} <= names


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("raise ImportError('no such library')", "no such library"),
        ("import os; os.abort()", "its process ended by SIGABRT"),
        ("import sys; print('lost: libfoo.so', file=sys.stderr); import os; os._exit(7)", "code 7: lost: libfoo.so"),
        ("raise SystemExit(3)", "3"),
    ],
)
def test_a_broken_dependency_costs_its_own_line_alone(broken, source: str, message: str) -> None:
    broken("scipy", source)
    first, wrong, last = findings(QUICK)
    assert first.ok and last.ok
    assert not wrong.ok and message in wrong.message and "\n" not in wrong.message


def test_a_dependency_that_hangs_is_given_up(broken) -> None:
    broken("filelock", "import time; time.sleep(300)")
    (found,) = findings(["filelock"], longest_s=3)
    assert not found.ok and found.message == "no answer within 3 s"


def test_wrong_results_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    import numpy as np
    import skimage.metrics

    monkeypatch.setattr(skimage.metrics, "structural_similarity", lambda *_, **__: 1.0)
    monkeypatch.setattr(np.linalg, "inv", np.transpose)
    assert not outcome("scikit-image")["ok"] and "with noise 1.000" in str(outcome("scikit-image")["message"])
    assert not outcome("numpy")["ok"]


def test_what_is_not_installed_is_wrong() -> None:
    assert outcome("no-such-distribution") == {
        "name": "no-such-distribution",
        "ok": False,
        "message": "No package metadata was found for no-such-distribution",
    }


def test_the_command_with_a_broken_dependency(broken, session_cache: Path) -> None:
    broken("small_gicp", "raise ImportError('hidden')")
    done = subprocess.run(
        [sys.executable, "-m", "pcdbench", "doctor", "--format", "json"], capture_output=True, text=True
    )
    assert done.returncode == 1
    said = json.loads(done.stdout)
    assert said["pcdbench"]["version"] == __version__
    assert said["machine"]["threads"] >= 1 and said["machine"]["python"] == sys.version.split()[0]
    assert said["packages"]["numpy"] and said["cache"]["folder"] == str(session_cache)
    assert len({name.lower() for name in said["packages"]}) == len(said["packages"])
    assert said["settings"]["PCDBENCH_CACHE"] == str(session_cache)
    assert all(free > 0 for free in said["free_disk_gb"].values())
    assert {"kind": "task", "name": "chamfer"}.items() <= next(
        its for its in said["plugins"]["found"] if its["name"] == "chamfer"
    ).items()
    names = [one["name"] for one in said["checks"]]
    assert names[: len(CHECKS)] == list(CHECKS) and {"lazrs", "pluggy"} <= set(names)
    assert [one["name"] for one in said["checks"] if not one["ok"]] == ["small-gicp"]


def test_sizes_of_a_folder(tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "data").write_bytes(bytes(2_000_000))
    (tmp_path / "a" / "loop").symlink_to(tmp_path)
    (tmp_path / "single").write_bytes(bytes(500_000))
    assert folder_sizes_mb(tmp_path) == {"a": 2.0, "single": 0.5}
    assert folder_sizes_mb(tmp_path / "none") == {}


def test_modules_of_distributions() -> None:
    assert "lazrs" in modules_of("lazrs")
    assert modules_of("pye57") == ["pye57"]
    assert modules_of("typer") == ["typer"]
