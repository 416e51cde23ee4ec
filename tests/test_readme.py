"""The README and the docs are true: the ten-line completer runs, the commands exist, the links lead somewhere."""

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "examples").rglob("*.md"))]


def block(language: str) -> str:
    """The README's only code block of a language."""
    (text,) = re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)
    return text


def test_the_completer_of_the_readme_keeps_its_contract(
    tmp_path: Path, wheel: Path, install_fresh: Callable[..., Path]
) -> None:
    package = tmp_path / "mirror"
    package.mkdir()
    (package / "mirror.py").write_text(block("python"))
    (package / "pyproject.toml").write_text(block("toml"))
    python = install_fresh(tmp_path / "env", wheel, package)
    check = "import mirror, pcdbench.testing; pcdbench.testing.check_completer(mirror.Mirror)"
    subprocess.run([python, "-c", check], cwd="/", check=True)
    listed = subprocess.run([python, "-m", "pcdbench", "list"], cwd="/", capture_output=True, text=True).stdout
    assert "  mirror " in listed and "mirror 1.0 (mirror = mirror)" in listed


def test_the_completer_of_the_readme_has_at_most_ten_lines() -> None:
    code = [line for line in block("python").splitlines() if line.strip() and '"""' not in line]
    assert len(code) <= 10


def test_the_two_commands_are_targets_of_the_makefile() -> None:
    commands = re.findall(r"^    make (\w+)$", README, re.MULTILINE)
    assert commands == ["demo", "test"]
    for command in commands:
        dry = subprocess.run(["make", "-n", command], cwd=ROOT, capture_output=True, text=True)
        assert dry.returncode == 0, dry.stderr
    assert "make test" in (ROOT / ".ci" / "run").read_text()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]+)", text):
        if "://" not in target:
            assert (page.parent / target).exists(), target
