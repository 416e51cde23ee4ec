"""The example of docs/viewing.md runs."""

import re
from pathlib import Path

import pytest

from pcdbench import PointCloud
from pcdbench.cli import app

TEXT = (Path(__file__).parents[2] / "docs" / "viewing.md").read_text()


@pytest.mark.usefixtures("tiny_plugins")
def test_the_notebook_example_runs(cloud: PointCloud, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner

    monkeypatch.chdir(tmp_path)
    cloud.select(slice(60)).write("scan.ply")
    cloud.write("completed.ply")
    run = ["run", "--completer", "tiny_fill", "--task", "tiny_gap", "--dataset", "tiny", "--incompleteness", "slab"]
    ended = CliRunner().invoke(app, [*run, "--jobs", "1", "--level", "0.3", "--out", "runs/NAME"])
    assert ended.exit_code == 0, ended.output
    (program,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    names: dict = {}
    exec(program, names)
    assert set(names["table"]["completer"]) >= {"tiny_fill", "incomplete"}
    assert len(names["samples"]) >= len(names["table"])
    assert "60 points" in names["scan"]._repr_html_() and Path("page.html").stat().st_size > 20_000
