"""Fixtures that many tests share: the real scans, a cache of the session's own, small clouds and a small room."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pcdbench.case import Case
from pcdbench.cloud import PointCloud
from pcdbench.plugins import registry
from pcdbench.scene import Scene
from pcdbench.testing import half_missing, small_room

ROOT = Path(__file__).parents[1]

# Started in the background of a script, this process would ignore Ctrl-C, and so would all that tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def session_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache folder of this session's own, shared by its xdist workers and by the commands that tests run.

    `PCDBENCH_TEST_CACHE` names one to keep from session to session.
    """
    kept = os.environ.get("PCDBENCH_TEST_CACHE")
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    path = Path(kept) if kept else shared / "pcdbench-cache"
    path.mkdir(parents=True, exist_ok=True)
    os.environ["PCDBENCH_CACHE"] = str(path)
    return path


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real scans; tests that want them skip where it is missing."""
    path = Path(os.environ.get("PCDBENCH_REAL_DATA") or ROOT.parent / "shared" / "data" / "real")
    if not path.is_dir():
        pytest.skip(f"no real scans at {path}; PCDBENCH_REAL_DATA names another place")
    return path


@pytest.fixture(scope="session")
def room() -> Scene:
    """A furnished, textured room of 4,000 points, with its mesh and boxes."""
    return small_room()


@pytest.fixture(scope="session")
def half_room(room: Scene) -> Case:
    """The room, half of it missing."""
    return half_missing(room, seed=0)


@pytest.fixture(scope="session")
def tracked_files() -> list[str]:
    """What git tracks and the working tree holds."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git checkout")
    return [name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


@pytest.fixture(scope="session")
def source(tracked_files: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what is tracked: building leaves files behind."""
    folder = tmp_path_factory.mktemp("pcdbench") / "source"
    for name in tracked_files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, folder / name)
    return folder


@pytest.fixture(scope="session")
def wheel(source: Path) -> Path:
    """pcdbench as a wheel."""
    pip = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "--no-index"]
    done = subprocess.run([*pip, "-w", source.parent, source], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (built,) = source.parent.glob("pcdbench-*.whl")
    return built


@pytest.fixture(scope="session")
def install_fresh() -> Callable[..., Path]:
    """Installs packages into a fresh environment that has our dependencies: `(folder, *what)`.

    Returns the environment's interpreter. Nothing is downloaded.
    """

    def install(folder: Path, *what: str | Path) -> Path:
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
        python = folder / "bin" / "python"
        (own,) = (folder / "lib").glob("python*/site-packages")
        # A path alone: editable installs there, pcdbench's own say, are .pth files too and stay unseen.
        (own / "outer.pth").write_text(sysconfig.get_path("purelib") + "\n")
        pip = [sys.executable, "-m", "pip", "--python", python, "install", "-q", "--ignore-installed"]
        offline = ["--no-deps", "--no-build-isolation", "--no-index"]
        done = subprocess.run([*pip, *offline, *what], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return python

    return install


@pytest.fixture
def cloud() -> PointCloud:
    """A hundred coloured points in a cube of 1 m."""
    rng = np.random.default_rng(0)
    return PointCloud(rng.random((100, 3)), rng.random((100, 3)))


@pytest.fixture
def tiny_plugins(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The plugins of tests/tiny, installed for this test, its worker processes and the commands it runs."""
    folder = ROOT / "tests" / "tiny"
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
    registry.cache_clear()
    yield folder
    registry.cache_clear()
