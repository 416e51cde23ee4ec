"""`read_results` and `read_figures`: a run as a table and as figures, in one call."""

import json
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from rows_for_tests import result_row
from typer.testing import CliRunner

import pcdbench
from pcdbench import PcdbenchError
from pcdbench.cli import app
from pcdbench.leaderboard.figures import write_task_figures
from pcdbench.runner import selection


@pytest.fixture
def run_of(tmp_path: Path) -> Callable[..., Path]:
    """A function that stores rows as a run."""

    def store(*rows: dict) -> Path:
        (tmp_path / "run.json").write_text(json.dumps({"schema_version": 1}))
        lines = [json.dumps(row | {"key": str(number), "trace": {}}) for number, row in enumerate(rows)]
        (tmp_path / "rows.jsonl").write_text("".join(line + "\n" for line in lines))
        return tmp_path

    return store


def test_the_table_is_what_the_command_prints(run_of: Callable[..., Path]) -> None:
    folder = run_of(
        result_row("a", [1, 2, 6], scene="one"),
        result_row("a", [3], scene="two"),
        result_row("a", [], scene="three", status="failed", error="it broke"),
        result_row("b", [5.5]),
    )
    table = pcdbench.read_results(str(folder))
    printed = CliRunner().invoke(app, ["results", str(folder), "--format", "csv"]).stdout
    pd.testing.assert_frame_equal(table, pd.read_csv(StringIO(printed)), check_dtype=False)
    (line,) = table[table["completer"] == "a"].to_dict("records")
    assert (line["median"], line["mean"], line["cases"], line["failed"]) == (2.5, 3, 2, 1)
    assert "_repr_html_" in dir(table)


def test_samples_are_a_line_each(run_of: Callable[..., Path]) -> None:
    folder = run_of(
        result_row("a", [1, 2, 6], scene="one"),
        result_row("a", [], scene="two"),
        result_row("b", [4], scene="two", level=0.5),
        result_row("b", [], status="skipped", error="no colour"),
    )
    table = pcdbench.read_results(folder, samples=True)
    shown = table[["completer", "scene", "level", "sample", "value"]].values.tolist()
    assert shown == [
        ["a", "one", 0.3, 0, 1.0],
        ["a", "one", 0.3, 1, 2.0],
        ["a", "one", 0.3, 2, 6.0],
        ["b", "two", 0.5, 0, 4.0],
    ]
    assert table["value"].dtype == np.float64
    assert table.groupby("completer")["value"].median().to_dict() == {"a": 2.0, "b": 4.0}


def test_figures_are_drawn_from_the_rows_and_a_failing_task_is_a_warning(
    run_of: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Draws:
        def figures(self, rows: pd.DataFrame) -> dict[str, Figure]:
            figure = Figure()
            figure.suptitle(f"{len(rows)} {rows['samples'].iloc[0]['error_m']}")
            return {"cdf": figure}

    class Fails:
        def figures(self, rows: pd.DataFrame) -> dict[str, Figure]:
            raise ValueError("no\n  depth")

    classes = {"draws": Draws, "fails": Fails}
    monkeypatch.setattr(selection.Plugin, "build", lambda self: classes[self.name]())
    rows = [result_row("a", [1.5], task=task) for task in ("fails", "draws")]
    for row in rows:
        row["task"] |= {"version": "1", "options": {}}
    with pytest.warns(UserWarning, match="^fails could not draw its figures: ValueError: no depth$"):
        figures = pcdbench.read_figures(run_of(*rows))
    assert list(figures) == ["draws_cdf"]
    assert figures["draws_cdf"].get_suptitle() == "1 [1.5]"
    plan = SimpleNamespace(tasks=[selection.Plugin("task", "fails", "1", {})])
    written, problems = write_task_figures(plan, [row | {"trace": {}} for row in rows], tmp_path / "figures")  # type: ignore[arg-type]
    assert written == [] and problems == ["fails could not draw its figures: ValueError: no depth"]


def test_a_run_without_figures_says_so_in_a_notebook(
    run_of: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    class DrawsNone:
        def figures(self, rows: pd.DataFrame) -> dict[str, Figure]:
            return {}

    monkeypatch.setattr(selection.Plugin, "build", lambda self: DrawsNone())
    row = result_row("a", [1.5])
    row["task"] |= {"version": "1", "options": {}}
    figures = pcdbench.read_figures(run_of(row))
    assert not figures and "draw no figures" in figures._repr_html_()


def test_each_incompleteness_has_figures_of_its_own(
    run_of: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Draws:
        def figures(self, rows: pd.DataFrame) -> dict[str, Figure]:
            figure = Figure()
            figure.suptitle(f"{len(rows)} {set(rows['incompleteness'])} {rows['missing'].mean():.2f}")
            return {"cdf": figure}

    monkeypatch.setattr(selection.Plugin, "build", lambda self: Draws())
    rows = [result_row("a", [1.5], scene=scene) for scene in ("one", "two", "three")]
    for row, incompleteness, missing in zip(rows, ("slab", "holes", "slab"), (0.2, None, 0.4), strict=True):
        row["task"] |= {"version": "1", "options": {}}
        row |= {"incompleteness": row["incompleteness"] | {"name": incompleteness}, "missing": missing}
    found = {name: figure.get_suptitle() for name, figure in pcdbench.read_figures(run_of(*rows)).items()}
    assert found == {"task_cdf_holes": "1 {'holes'} nan", "task_cdf_slab": "2 {'slab'} 0.30"}


@pytest.mark.parametrize("read", [pcdbench.read_results, pcdbench.read_figures])
def test_mistakes_are_one_line(read: Callable[[Path], object], run_of: Callable[..., Path], tmp_path: Path) -> None:
    with pytest.raises(PcdbenchError, match=r"is not a run: it has no run\.json"):
        read(tmp_path / "nowhere")
    with pytest.raises(PcdbenchError, match="has no rows yet; give its command again"):
        read(run_of())
