"""A publication's page: numbers of the rows beside the published ones, and what is left out is told with its reason."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file
from typer.testing import CliRunner

from pcdbench.cli import app
from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.summary import summarize
from pcdbench.paper.drawing import _panels, _with_legend
from pcdbench.paper.numbers import _parameters
from pcdbench.paper.publication import ShownCurve, read_publication
from pcdbench.plugins import registry
from pcdbench.runner.store import read_rows

PUBLICATION = """
title = "Filling boxes"
venue = "Nowhere 2020"
[differs]
data = "Boxes."

[runs.main]
incompletenesses = ["slab"]
levels = [0.3, 0.5]
completers = ["tiny_fill"]
tasks = ["tiny_gap"]
references = true

[runs.many]
incompletenesses = ["slab"]
levels = [0.3]
completers = [{ name = "tiny_fill", options = { points = 50 } }]
tasks = ["tiny_gap"]
dataset_options = { points = 600 }

[runs.learned]
levels = [0.3]
completers = ["tiny_fill"]
tasks = ["tiny_gap"]
trained = "its_own"

[[parts]]
number = "Table 1"
title = "Gaps"
columns = [
    { heading = "gap, mm", task = "tiny_gap", metric = "gap_m", statistic = "mean", factor = 1000 },
    { heading = "seconds", metric = "seconds" },
]
rows = [
    { heading = "30", run = "main", completer = "tiny_fill", level = 0.3, published = [12.5, ""] },
    { heading = "50", run = "main", completer = "tiny_fill", level = 0.5 },
    { heading = "few", run = "many", completer = "tiny_fill", level = 0.3 },
    { heading = "learned", run = "learned", completer = "tiny_fill", level = 0.3, published = [1, 2] },
]

[[parts]]
number = "Figure 1"
title = "Distribution"
figure = { kind = "distribution", run = "main", task = "tiny_gap", levels = [0.3, 0.5] }

[[parts]]
number = "Figure 2"
title = "By points"
[parts.figure]
kind = "curve"
label = "points"
completer = "tiny_fill"
level = 0.3
column = { heading = "gap", task = "tiny_gap", metric = "gap_m", statistic = "mean" }
points = [{ at = 300, run = "main", published = 0.1 }, { at = 600, run = "many" }]

[[parts]]
number = "Figure 3"
title = "Bars"
[parts.figure]
kind = "bars"
run = "main"
levels = [0.3, 0.5]
completers = ["incomplete", "tiny_fill"]
column = { heading = "gap", task = "tiny_gap", metric = "gap_m", statistic = "mean" }
published = [{ completer = "tiny_fill", level = 0.3, value = 0.05 }]
"""


@pytest.fixture
def paper(tmp_path, tiny_plugins, monkeypatch):
    """Run the command on the publication above in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    Path("boxes.toml").write_text(PUBLICATION)

    def call(*arguments: str, code: int = 0):
        tiny = ("--dataset", "tiny", "--jobs", "1", "--out", "paper")
        ended = CliRunner().invoke(app, ["paper", "boxes.toml", *tiny, *arguments])
        assert ended.exit_code == code, ended.output
        return ended

    return call


def cells_of(page: str, heading: str) -> list[str]:
    return re.search(rf"^\| {heading} \| (.*) \|$", page, re.MULTILINE)[1].split(" | ")


def test_the_page_has_the_rows_numbers_beside_the_published_ones(paper) -> None:
    ended = paper("--page", "docs/boxes.md")
    page = Path("docs/boxes.md").read_text()
    rows = read_rows(Path("paper/runs/main"))
    table = summarize(rows)
    its = table[(table["completer"] == "tiny_fill") & (table["metric"] == "gap_m")].set_index("level")
    for heading, level in (("30", 0.3), ("50", 0.5)):
        expected = 1000 * its.loc[level, ["mean", "mean_low", "mean_high"]]
        gap, published, seconds, _ = cells_of(page, heading)
        assert gap == "{:.3g} [{:.3g}, {:.3g}]".format(*expected)
        assert published == ("12.5" if heading == "30" else "") and float(seconds) >= 0
    many = summarize(read_rows(Path("paper/runs/many")))
    gap = many[many["metric"] == "gap_m"]["mean"].iloc[0]
    assert cells_of(page, "few")[0].startswith(f"{1000 * gap:.3g} [")
    assert "Measured on `tiny` version 1, split `few`: 3 scenes, 3 cases at each level" in page
    for number in (1, 2, 3):
        assert f"(boxes/figure_{number}.svg)" in page
        assert Path(f"docs/boxes/figure_{number}.svg").read_text().startswith("<?xml")
    assert "published" in Path("docs/boxes/figure_2.svg").read_text()
    assert cells_of(page, "learned")[0] == "\N{EN DASH}"
    assert "`learned` was not run: it needs weights of its own: give --weights FOLDER" in page
    assert "learned is left out" in ended.stderr
    assert "What they were trained for" not in page, "nobody learned"


def test_going_on_does_only_what_is_missing_and_writes_the_same_page(paper) -> None:
    paper()
    written = Path("paper/runs/main/rows.jsonl").read_bytes(), Path("paper/paper.md").read_text()
    paper()
    assert (Path("paper/runs/main/rows.jsonl").read_bytes(), Path("paper/paper.md").read_text()) == written


def test_rows_of_another_run_count_where_the_code_is_the_same(paper) -> None:
    run = ["run", "--dataset", "tiny", "--completer", "tiny_fill", "--task", "tiny_gap,tiny_color", "--jobs", "1"]
    run += ["--incompleteness", "slab", "--level", "0.3", "--out", "earlier"]
    assert CliRunner().invoke(app, run).exit_code == 0
    told = paper("--take-from", "earlier").stderr
    taken = {row["key"] for row in read_rows(Path("earlier"))} & {
        row["key"] for row in read_rows(Path("paper/runs/main"))
    }
    assert len(taken) == 3 * 4 and f"{len(taken)} rows are taken from earlier" in told
    times = {row["key"]: row["time"] for row in read_rows(Path("earlier"))}
    assert all(row["time"] == times.get(row["key"], row["time"]) for row in read_rows(Path("paper/runs/main")))

    facts = Path("earlier/run.json")
    facts.write_text(re.sub(r'("name": "tiny_fill".*?"code": ")\w+', r"\1of yesterday", facts.read_text(), flags=re.S))
    other = CliRunner().invoke(
        app, ["paper", "boxes.toml", "--dataset", "tiny", "--jobs", "1", "--out", "other", "--take-from", "earlier"]
    )
    assert other.exit_code == 0 and "9 rows are taken from earlier" in other.stderr, "references' code is the same"

    facts.write_text(re.sub(r'("name": "tiny",.*?"code": ")\w+', r"\1of yesterday", facts.read_text(), flags=re.S))
    more = ["--dataset", "tiny", "--jobs", "1", "--out", "data", "--take-from", "earlier"]
    other = CliRunner().invoke(app, ["paper", "boxes.toml", *more])
    assert other.exit_code == 0 and "are taken from" not in other.stderr, "they are of other data"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'run = "many", completer',
            'run = "more", completer',
            r"Table 1 is made of the run 'more', which is not there",
        ),
        ('published = [12.5, ""]', "published = [12.5]", r"Table 1, 30: 1 published numbers for 2 columns"),
        ('metric = "seconds"', 'metric = "hours"', r"Table 1: seconds has no task"),
        ("references = true", 'split = "few"', r"the run main says split, which the command line does"),
        (
            'incompletenesses = ["slab"]\nlevels = [0.3, 0.5]',
            'incompletenesses = ["slab", "holes"]\nlevels = [0.3, 0.5]',
            r"the run main needs one incompleteness; make it a run for each",
        ),
        (
            'incompletenesses = ["slab"]\nlevels = [0.3, 0.5]',
            'incompletenesses = ["all"]\nlevels = [0.3, 0.5]',
            r"the run main needs one incompleteness; make it a run for each",
        ),
        ('kind = "bars"', 'kind = "pie"', r"figure"),
        ('title = "Gaps"', 'titel = "Gaps"', r"parts\.0\.title: field required"),
        ("[differs]", "[differs", r"is not TOML"),
        (
            'completers = ["tiny_fill"]\ntasks = ["tiny_gap"]\nreferences',
            'completers = ["tiny_fil"]\ntasks = ["tiny_gap"]\nreferences',
            r"the run main: no completer is called 'tiny_fil'; did you mean tiny_fill",
        ),
        (
            'run = "main", completer = "tiny_fill", level = 0.5',
            'run = "main", completer = "tiny_fil", level = 0.5',
            r"Table 1: the run main has no completer 'tiny_fil'; did you mean tiny_fill",
        ),
        ("level = 0.5 }", "level = 0.1 }", r"Table 1: the run main has no level 0\.1; it has 0\.3, 0\.5"),
        (
            'metric = "gap_m", statistic = "mean", factor',
            'metric = "gap", factor',
            r"tiny_gap has no metric 'gap'; did",
        ),
        (
            'run = "main", task = "tiny_gap"',
            'run = "main", task = "chamfer"',
            r"Figure 1: the run main has no task 'cha",
        ),
        (
            'column = { heading = "gap", task = "tiny_gap", metric = "gap_m"',
            'column = { heading = "gap", task = "tiny_gap", metric = "gapm"',
            r"Figure 2: tiny_gap has no metric",
        ),
        (
            'published = [{ completer = "tiny_fill"',
            'published = [{ completer = "pcn"',
            r"Figure 3: the run main has no",
        ),
    ],
)
def test_mistakes_in_the_file_are_told(paper, old: str, new: str, message: str) -> None:
    assert old in PUBLICATION
    Path("boxes.toml").write_text(PUBLICATION.replace(old, new))
    ended = paper(code=2)
    assert re.search(message, ended.stderr), ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1


def test_where_nothing_was_measured_there_is_no_page_but_the_reason(paper) -> None:
    head, parts = PUBLICATION[: PUBLICATION.index("[runs.main]")], PUBLICATION.index("[[parts]]")
    learned = PUBLICATION[PUBLICATION.index("[runs.learned]") : parts]
    Path("boxes.toml").write_text(f"{head}{learned}[[parts]]\nnumber = 'Table 1'\ntitle = 'Gaps'\n")
    ended = paper(code=2)
    assert "pcdbench: nothing was measured, so there is no page: it needs weights of its own" in ended.stderr
    assert not Path("paper/paper.md").exists()


WHERE = r"a completer that has one \(deeppcd, deeppcd_merged\) or a publication\.toml"


@pytest.mark.parametrize("name", ["plane_fitting", "tiny_fill"])
def test_a_completer_without_a_publication_says_so(tiny_plugins, name: str) -> None:
    with pytest.raises(PcdbenchError, match=rf"{name} has no publication\.toml in its package; give {WHERE}$"):
        read_publication(name)


def test_without_a_publication_those_that_there_are_are_named_in_one_line() -> None:
    ended = CliRunner().invoke(app, ["paper"])
    assert ended.exit_code == 2
    assert re.fullmatch(rf"pcdbench: say which publication: {WHERE}\n", ended.stderr), ended.stderr


def test_deeppcd_has_the_published_tables_and_figures() -> None:
    publication = read_publication("deeppcd")
    parts = {part.number: part for part in publication.parts}
    assert set(parts) == {f"Table {n}" for n in range(8, 14)} | {f"Figure {n}" for n in (5, 7, 9, 13, 14, 15)}
    by_level = {row.level: row.published for row in parts["Table 8"].rows if row.completer == "deeppcd"}
    assert by_level == {0.5: [10.1, 25.7, 0.81, 0.89], 0.3: [3.9, 10.8, 0.89, 0.95], 0.1: [2.6, 7.1, 0.93, 0.97]}
    grid = parts["Figure 9"].figure
    assert isinstance(grid, ShownCurve) and [point.at for point in grid.points] == [3, 4, 5, 6, 7]
    for point in grid.points:
        options = publication.runs[point.run].completers[0].options
        assert options.get("grid", 5) == point.at


def test_every_number_of_deeppcd_is_one_that_is_measured() -> None:
    publication = read_publication("deeppcd")
    for part in publication.parts:
        figure = [] if part.figure is None or part.figure.kind == "distribution" else [part.figure.column]
        for column in [*part.columns, *figure]:
            if column.task:
                metrics = registry().get("task", column.task).load().metrics
                assert column.metric in [metric.name for metric in metrics], (part.number, column.heading)
        for run in part.runs:
            named = {entry.name for entry in publication.runs[run].completers}
            references = {its.name for its in registry().all("completer") if its.reference}
            measured = named | (references if publication.runs[run].references else set())
            assert {row.completer for row in part.rows if row.run == run} <= measured, part.number


def test_running_statistics_are_no_parameters(tmp_path: Path) -> None:
    norm = {f"norm.{name}": np.ones(5, np.float32) for name in ("weight", "bias", "running_mean", "running_var")}
    standardized = {f"features.{name}": np.ones(7, np.float32) for name in ("mean", "variance")}
    counts = {name: np.array(9) for name in ("norm.num_batches_tracked", "features.seen")}
    save_file(norm | standardized | counts | {"meaning.weight": np.ones((2, 3))}, tmp_path / "weights.safetensors")
    assert _parameters(tmp_path / "weights.safetensors") == 5 + 5 + 6
    (shipped,) = registry().get("completer", "deeppcd").load()().weights_files()
    assert _parameters(shipped) == 7_735_055


@pytest.mark.parametrize("count", [2, 5, 7])
def test_a_legend_is_as_wide_as_its_figure_at_most(count: int) -> None:
    figure, (panel,) = _panels(1)
    for number in range(count):
        panel.plot([0, 1], [0, number], label=f"completer_number_{number}")
    (legend,) = _with_legend(figure, panel).legends
    figure.draw_without_rendering()
    extent = legend.get_window_extent()
    assert figure.bbox.x0 <= extent.x0 < extent.x1 <= figure.bbox.x1 and extent.y0 >= figure.bbox.y0
    assert len(legend.get_texts()) == count and panel.get_window_extent().height > 100
