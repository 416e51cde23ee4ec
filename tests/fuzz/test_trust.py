"""What is read is data: nothing unpickles or evaluates it, and nothing in a run's folder is imported."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest
from fuzz_seeds import valid_run

import pcdbench
from pcdbench.errors import PcdbenchError

ROOT = Path(__file__).parents[2]
PACKAGES = ("pcdbench", "completers", "tasks")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
FORBIDDEN_MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve", "yaml"}
FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__", "execfile"}
FORBIDDEN_ATTRIBUTES = {
    ("torch", "load"), ("torch", "compile_package"), ("os", "system"), ("os", "popen"), ("pd", "read_pickle"),
    ("pandas", "read_pickle"), ("np", "fromregex"), ("runpy", "run_path"), ("jsonpickle", "decode"),
}  # fmt: skip
# It pickles an author's options and takes them back, to show that worker processes can be given them.
EXEMPT = {"pcdbench/testing.py": {"pickle"}}


def violations(source: str) -> set[str]:
    """What a module does that could run what it reads."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names} & FORBIDDEN_MODULES
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found |= {node.module.split(".")[0]} & FORBIDDEN_MODULES
        elif isinstance(node, ast.Call):
            keywords = {keyword.arg: keyword.value for keyword in node.keywords}
            if isinstance(node.func, ast.Name) and node.func.id in FORBIDDEN_CALLS:
                found.add(node.func.id)
            if isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name):
                name = (node.func.value.id, node.func.attr)
                if name in FORBIDDEN_ATTRIBUTES:
                    found.add(".".join(name))
                if name in {("np", "load"), ("numpy", "load")} and not _is(keywords.get("allow_pickle"), False):
                    found.add("np.load without allow_pickle=False")
            if _is(keywords.get("allow_pickle"), True):
                found.add("allow_pickle=True")
            if _is(keywords.get("shell"), True):
                found.add("shell=True")
    return found


def _is(node: ast.expr | None, value: bool) -> bool:
    return isinstance(node, ast.Constant) and node.value is value


def test_no_module_runs_what_it_reads() -> None:
    found = {path.relative_to(ROOT).as_posix(): violations(path.read_text(encoding="utf-8")) for path in SOURCES}
    assert len(found) > 100
    assert {name: its - EXEMPT.get(name, set()) for name, its in found.items() if its - EXEMPT.get(name, set())} == {}


@pytest.mark.parametrize(
    "source",
    [
        "import pickle", "from pickle import loads", "import torch\ntorch.load('a')", "eval('1')",
        "import numpy as np\nnp.load('a')", "import numpy as np\nnp.load('a', allow_pickle=True)",
        "import subprocess\nsubprocess.run('a', shell=True)",
    ],
)  # fmt: skip
def test_the_search_finds_what_it_looks_for(source: str) -> None:
    assert violations(source)


def test_a_run_that_names_code_of_its_own_runs_none_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:

    valid_run(tmp_path)
    (tmp_path / "evil.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    (tmp_path / "conftest.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    for task in ("evil", "evil:Task", "../evil", str(tmp_path / "evil.py")):
        rows = [json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines()]
        for row in rows:
            row["task"]["name"] = task
        (tmp_path / "rows.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
        monkeypatch.chdir(tmp_path)
        assert set(pcdbench.read_results(tmp_path)["task"]) == {task}
        with pytest.raises(PcdbenchError, match="no task is called"):
            pcdbench.read_figures(tmp_path)
    assert not (tmp_path / "ran").exists()


def test_workers_take_no_module_of_the_working_folder(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "selectors.py").write_text("raise SystemExit('code of the folder')")
    # As the console script is: its own folder, and not the working one, is where Python looks first.
    (tmp_path / "script.py").write_text(
        """
import multiprocessing, os, sys
from pcdbench import __main__
from pcdbench.workers import begin_worker

def work():
    begin_worker(1)
    assert "PYTHONSAFEPATH" not in os.environ

if __name__ == "__main__":
    sys.argv[1:] = ["--version"]
    try:
        __main__.main()
    except SystemExit:
        worker = multiprocessing.get_context("spawn").Process(target=work)
        worker.start()
        worker.join()
        sys.exit(worker.exitcode)
"""
    )
    command = [sys.executable, str(tmp_path / "script.py")]
    ended = subprocess.run(command, cwd=tmp_path / "run", capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_names_of_figures_do_not_leave_their_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from types import SimpleNamespace

    from matplotlib.figure import Figure

    from pcdbench.leaderboard import figures

    names = ["../../out", "/tmp/out", "a/b", "x" * 400, "plain"]
    monkeypatch.setattr(figures, "figures_of", lambda *_: {name: Figure(figsize=(1, 1)) for name in names})
    plan = SimpleNamespace(tasks=[SimpleNamespace(name="task")])
    written, problems = figures.write_task_figures(plan, [], tmp_path / "run" / "figures")  # type: ignore[arg-type]
    assert problems == [] and len(set(written)) == len(names)
    assert sorted(tmp_path.rglob("*.png")) == sorted(written)
    assert {path.parent for path in written} == {tmp_path / "run" / "figures"}
    assert (tmp_path / "run" / "figures" / "task_plain.png").is_file()
