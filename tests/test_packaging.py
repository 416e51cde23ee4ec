"""Wheel and editable install hold every package, and the constraints pin every dependency."""

import ast
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from pcdbench import __version__

ROOT = Path(__file__).parents[1]
CONFIG = tomllib.loads((ROOT / "pyproject.toml").read_text())
FOLDER_OF_PACKAGE = CONFIG["tool"]["setuptools"]["package-dir"]


@pytest.fixture
def modules(tracked_files: list[str]) -> dict[str, str]:
    """By tracked Python file of our packages: where it lies once installed."""
    return {
        name: "/".join([package, *Path(name).relative_to(folder).parts])
        for package, folder in FOLDER_OF_PACKAGE.items()
        for name in tracked_files
        if name.startswith(f"{folder}/") and name.endswith(".py")
    }


def test_pyproject_lists_every_package(modules: dict[str, str]) -> None:
    folders = {".".join(Path(installed).parent.parts) for installed in modules.values()}
    assert set(CONFIG["tool"]["setuptools"]["packages"]) == folders


def test_the_wheel_holds_every_module_and_nothing_beside(wheel: Path, modules: dict[str, str]) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    assert set(modules.values()) == {name for name in names if name.endswith(".py")}
    assert "pcdbench/py.typed" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert {name.split("/")[0] for name in names} == {*FOLDER_OF_PACKAGE, f"pcdbench-{__version__}.dist-info"}


@pytest.mark.parametrize("editable", [False, True])
def test_an_installation_works_from_any_folder(
    editable: bool, source: Path, wheel: Path, tmp_path: Path, install_fresh: Callable[..., Path]
) -> None:
    python = install_fresh(tmp_path / "env", *(["-e", source] if editable else [wheel]))
    program = (
        "import pcdbench, pcdbench_completers, pcdbench_tasks\n"
        "from pcdbench.plugins import KINDS, registry\n"
        "assert registry().broken == {} and registry().clashes() == []\n"
        "for module in (pcdbench, pcdbench_completers, pcdbench_tasks): print(module.__file__)\n"
        "print(*(one.load().__name__ for kind in KINDS for one in registry().all(kind)))"
    )
    done = subprocess.run([python, "-I", "-c", program], cwd="/", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    *files, classes = done.stdout.splitlines()
    assert all(Path(file).is_relative_to(source if editable else tmp_path / "env") for file in files)
    assert {"PlaneFitting", "Chamfer", "Indoor", "Holes"} <= set(classes.split())
    command = [python.parent / "pcdbench", "--version"]
    assert subprocess.run(command, cwd="/", capture_output=True, text=True).stdout == f"pcdbench {__version__}\n"


def test_the_version_is_the_same_everywhere() -> None:
    assert CONFIG["project"]["version"] == __version__ == version("pcdbench")


def test_the_python_versions_are_the_same_everywhere() -> None:
    project = CONFIG["project"]
    language, supported = "Programming Language :: Python :: ", SpecifierSet(project["requires-python"])
    named = [text.removeprefix(language) for text in project["classifiers"] if text.startswith(language)]
    assert named == [one for one in (f"3.{minor}" for minor in range(100)) if one in supported]
    for path in ("README.md", "Makefile"):
        assert f"Python {named[0]} to {named[-1]}" in (ROOT / path).read_text()


@pytest.mark.parametrize("version", [(3, 10), (3, 14)])
def test_make_with_another_python_says_so_and_sets_nothing_up(version: tuple[int, int], tmp_path: Path) -> None:
    (tmp_path / "Makefile").write_text((ROOT / "Makefile").read_text())
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "constraints.txt").touch()
    pretends = f"import sys; sys.version_info = {version}; exec(sys.argv[2])"
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} -c "{pretends}" "$@"\n')
    python.chmod(0o755)
    done = subprocess.run(["make", "demo", f"PYTHON={python}"], cwd=tmp_path, capture_output=True, text=True)
    said = f"{python} is Python {version[0]}.{version[1]}; pcdbench needs Python 3.11 to 3.13: make PYTHON="
    assert done.returncode != 0 and any(line.startswith(said) for line in done.stderr.splitlines())
    assert not (tmp_path / ".venv").exists()


def test_the_licence_is_apache_2() -> None:
    text = (ROOT / "LICENSE").read_text()
    assert CONFIG["project"]["license"] == "Apache-2.0"
    assert "Apache License" in text and "Version 2.0, January 2004" in text and "END OF TERMS AND CONDITIONS" in text


def test_every_dependency_direct_or_not_is_pinned_to_a_version_it_accepts() -> None:
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
    pinned = {canonicalize_name(name): pin for name, _, pin in (line.partition("==") for line in lines)}
    extra = CONFIG["project"]["optional-dependencies"]["dev"]
    waiting = [(Requirement(text), "pcdbench") for text in CONFIG["project"]["dependencies"] + extra]
    seen = set()
    while waiting:
        requirement, wanted_by = waiting.pop()
        name = canonicalize_name(requirement.name)
        assert name in pinned, f"{requirement} of {wanted_by} is not in constraints.txt"
        assert requirement.specifier.contains(pinned[name], prereleases=True), f"{requirement} of {wanted_by}"
        if (name, frozenset(requirement.extras)) in seen:
            continue
        seen.add((name, frozenset(requirement.extras)))
        try:
            further = requires(requirement.name) or []
        except PackageNotFoundError:
            pytest.fail(f"{requirement} of {wanted_by} is not installed")
        for text in further:
            one = Requirement(text)
            # PyPI's torch for Linux pins the CUDA libraries that it was built with; a CPU build asks for none.
            if name == "torch" and "platform_system" in str(one.marker):
                continue
            if one.marker is None or any(one.marker.evaluate({"extra": extra}) for extra in ("", *requirement.extras)):
                waiting.append((one, name))


def test_imports_are_declared_and_declared_dependencies_imported(modules: dict[str, str]) -> None:
    project = CONFIG["project"]
    declared = {canonicalize_name(Requirement(text).name) for text in project["dependencies"]}
    optional = {canonicalize_name(Requirement(text).name) for text in project["optional-dependencies"]["dask"]}
    # Dask's extra `distributed` is a distribution of its own.
    distribution = {"skimage": "scikit-image", "distributed": "dask"}
    used = set()
    for path in modules:
        for node in ast.walk(ast.parse((ROOT / path).read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                names = [node.module]
            used |= {name.split(".")[0] for name in names}
    used -= sys.stdlib_module_names | FOLDER_OF_PACKAGE.keys()
    used = {canonicalize_name(distribution.get(name, name)) for name in used}
    assert used - declared - optional == set(), "imported but not declared"
    # laspy reads LAZ through lazrs, which it imports itself.
    assert declared - used - {"lazrs"} == set(), "declared but not imported"
