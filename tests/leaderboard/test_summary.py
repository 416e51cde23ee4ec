"""Summaries by hand-computed cases: what is counted, paired and shown."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from rows_for_tests import result_row

from pcdbench.cli.results import print_summary
from pcdbench.leaderboard.render import markdown, number, print_tables, records, summary_tables
from pcdbench.leaderboard.summary import reasons, summarize


def test_samples_of_all_cases_are_pooled():
    rows = [
        result_row("a", [1, 2, 3], scene="x", seconds=1.0),
        result_row("a", [10], scene="y", seconds=3.0),
        result_row("a", [3], scene="y", draw=1, seconds=8.0),
    ]
    (line,) = records(summarize(rows))
    assert (line["median"], line["mean"], line["scenes"], line["cases"]) == (3.0, 3.8, 2, 3)
    assert line["p90"] == pytest.approx(np.quantile([1, 2, 3, 3, 10], 0.9))
    assert (line["seconds"], line["memory_mb"]) == (3.0, 2.0)
    assert line["median_low"] <= 3.0 <= line["median_high"]


def test_small_numbers_keep_their_digits():
    (line,) = json.loads(json.dumps(records(summarize([result_row("a", [1.23456789e-12])]))))
    assert line["mean"] == 1.23456789e-12


def test_a_case_without_samples_was_not_measured_and_takes_no_bold():
    rows = [result_row(name, [1.0], scene=scene) for scene in "xy" for name in "ab"]
    rows += [result_row("a", [0.5], scene="z"), result_row("b", [], scene="z"), result_row("b", [], scene="w")]
    first, second = records(summarize(rows))
    assert [(line["scenes"], line["cases"]) for line in (first, second)] == [(3, 3), (2, 2)]
    page = markdown(summary_tables(summarize(rows)))
    assert [line.split("|")[2].strip() for line in page.splitlines() if "**" in line] == ["**a**"]
    unmeasured = result_row("c", []) | {"metrics": {}}
    assert [(line["completer"], line["cases"]) for line in records(summarize([*rows, unmeasured]))][2:] == [("c", 0)]


def test_scenes_of_one_environment_are_drawn_together():
    values = {("a", 0): 1.0, ("a", 1): 1.2, ("b", 0): 5.0, ("b", 1): 5.2, ("c", 0): 9.0, ("c", 1): 9.2}
    alone = [result_row("it", [value], scene=f"{of}_{crop}") for (of, crop), value in values.items()]
    parts = [row | {"dataset": {"environment": row["scene"][0]}} for row in alone]
    merged = [
        result_row("it", [value for (its, _), value in values.items() if its == of], scene=of) for of in ("a", "b", "c")
    ]
    of_alone, of_parts, of_merged = (records(summarize(rows))[0] for rows in (alone, parts, merged))
    assert (of_parts["scenes"], of_parts["cases"]) == (6, 6)
    for end in ("mean_low", "mean_high", "median_low", "median_high", "p90_low", "p90_high"):
        assert of_parts[end] == of_merged[end]
    assert of_parts["mean_low"] < of_alone["mean_low"]


def test_the_share_that_was_missing_is_the_mean_of_the_cases_that_tell_it():
    shares = {"x": 0.2, "y": 0.5, "z": None}
    rows = [result_row("a", [1.0], scene=scene) | {"missing": share} for scene, share in shares.items()]
    (line,) = records(summarize([*rows, result_row("a", [1.0], scene="w")]))
    assert line["missing"] == pytest.approx(0.35) and line["cases"] == 4


def test_failed_timed_out_and_skipped_cases_are_counted_not_averaged():
    rows = [
        result_row("a", [1.0], scene="x"),
        result_row("a", [], scene="y", status="failed", error="E"),
        result_row("a", [], scene="z", status="timeout", error="T"),
        result_row("a", [], scene="w", status="skipped", error="S"),
        result_row("b", [], scene="x", status="failed", error="E"),
    ]
    first, second = records(summarize(rows))
    assert (first["cases"], first["failed"], first["skipped"], first["median"]) == (1, 2, 1, 1.0)
    assert (second["completer"], second["cases"], second["failed"], second["median"]) == ("b", 0, 1, None)
    page = markdown(summary_tables(summarize(rows)))
    assert "1 (2 failed, 1 skipped)" in page and "0 (1 failed)" in page


def test_who_gave_back_what_was_taken_away_is_told_with_the_tables(capsys):
    rows = [result_row(name, [1.0], scene=scene, task=task) for name in "ab" for scene in "xyz" for task in ("t", "u")]
    rows = [row | ({"foreknown": 0.5} if row["cell"].startswith(("a x", "a y")) else {}) for row in rows]
    told = "a: 2 of 3 completed clouds hold points that were taken away, to the last bit (at most 50% of them)"
    print_summary(rows, Path("run"), "table")
    assert capsys.readouterr().out.count(told) == 1
    print_summary(rows, Path("run"), "json")
    assert list(json.loads(capsys.readouterr().out)["foreknown"]) == ["a"]
    print_summary([row for row in rows if "foreknown" not in row], Path("run"), "table")
    assert "taken away" not in capsys.readouterr().out


def test_the_order_of_rows_changes_nothing():
    rng = np.random.default_rng(0)
    rows = [
        result_row(name, rng.random(3), scene=scene, level=level)
        for level in (0.5, 0.1)
        for scene in "vwxyz"
        for name in ("b", "a", "incomplete")
    ]
    expected = records(summarize(rows))
    assert records(summarize([rows[index] for index in rng.permutation(len(rows))])) == expected
    assert [(line["level"], line["completer"]) for line in expected] == [
        (level, name) for level in (0.1, 0.5) for name in ("incomplete", "a", "b")
    ]


def test_rows_are_looked_at_once():
    rows = [result_row(name, [1.0, 2.0], scene=scene) for scene in "xy" for name in "ab"]
    assert records(summarize(iter(rows))) == records(summarize(rows))


@pytest.mark.parametrize(("direction", "best"), [("lower", "a"), ("higher", "b")])
def test_the_best_completer_stands_out_and_references_do_not_compete(direction, best):
    rows = [
        result_row(name, [value], scene=scene, direction=direction)
        for scene in "xy"
        for name, value in (("ground_truth", 0.0), ("incomplete", 9.0), ("a", 1.0), ("b", 2.0))
    ]
    page = markdown(summary_tables(summarize(rows)))
    bold = [line.split("|")[2].strip() for line in page.splitlines() if "**" in line]
    assert bold == [f"**{best}**"]
    assert "*ground_truth*" in page


def test_names_and_errors_cannot_break_markdown(capsys):
    rows = [
        result_row("a|b\n*c*", [1.0], task="t\n|u", metric="e|m"),
        result_row("d", [], task="t\n|u", status="failed", error="no | plane\n\n# in <b>"),
    ]
    print_summary(rows, Path("run"), "markdown")
    title, _, header, rules, *lines = capsys.readouterr().out.splitlines()
    assert title == "### t \\|u · e\\|m (m; lower is better) · holes"
    table = [header, rules, *lines[:2]]
    assert {line.replace("\\|", "").count("|") for line in table} == {8}
    assert "| **a\\|b \\*c\\*** |" in table[2]
    assert lines[-1] == "- 1 failed: d on t \\|u: no \\| plane \\# in &lt;b&gt;"


def test_a_reason_of_several_completers_is_told_once():
    lost = [
        result_row(completer, [], scene="room1", task=task, status="failed", error="room1.ply is empty")
        for completer in ("a", "b")
        for task in ("one", "two")
    ]
    other = result_row("c", [], scene="room1", task="one", status="failed", error="room1.ply is empty")
    assert reasons([*lost, other]) == [
        "4 failed: a, b on one, two: room1.ply is empty",
        "1 failed: c on one: room1.ply is empty",
    ]


def test_reasons_are_counted_failures_first_and_alike_ones_once():
    rows = [
        result_row("a", [], scene=f"room{n}", status="skipped", error=f"room{n} has {n} points") for n in range(3)
    ] + [result_row("b", [], status="failed", error="E: x", task=task) for task in ("t2", "t1")]
    assert reasons(rows) == [
        "2 failed: b on t1, t2: E: x",
        "3 skipped: a on task: room0 has 0 points (and alike)",
    ]


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.00039, "", "3.9e-4"),
        (0.0, "m", "0"),
        (0.893, "", "0.893"),
        (0.0061, "m", "0.006"),
        (0.0001, "m", "1.0e-4"),
        (12.34, "", "12.3"),
        (-0.5, "", "-0.500"),
        (float("nan"), "", "-"),
    ],
)
def test_numbers_for_people(value, unit, text):
    assert number(value, unit) == text


@pytest.mark.parametrize(
    ("summary", "kept", "gone"), [("median", "median [95 %]", "mean [95 %]"), ("mean", "mean [95 %]", "median [95 %]")]
)
def test_a_narrow_terminal_shows_whole_names_levels_and_the_declared_statistic(summary, kept, gone):
    rows = [
        result_row(completer, [12.345 + place], scene=f"s{place}")
        for place in range(3)
        for completer in ("incomplete", "a_completer_with_a_name_longer_than_most")
    ]
    for its in rows:
        its["metrics"]["error_m"]["summary"] = summary
    rows += [result_row("incomplete", [], scene=f"f{place}", status="failed", error="E") for place in range(3)]
    tables = summary_tables(summarize(rows))
    narrow, wide = (Console(file=io.StringIO(), width=width) for width in (75, 200))
    print_tables(tables, narrow)
    print_tables(tables, wide)
    shown = narrow.file.getvalue()
    assert kept in shown and gone not in shown and "…" not in shown
    assert "30%" in shown and "(3" in shown and "failed)" in shown and "--format markdown has all" in shown
    whole = wide.file.getvalue()
    assert kept in whole and gone in whole and "--format markdown" not in whole


def test_what_stands_out_is_marked_where_text_has_no_styles():
    tables = summary_tables(summarize([result_row("incomplete", [1.0]), result_row("other", [2.0])]))
    plain = Console(file=io.StringIO(), width=150)
    print_tables(tables, plain)
    assert "*incomplete*" in plain.file.getvalue() and "**other**" in plain.file.getvalue()
    styled = Console(file=io.StringIO(), width=150, force_terminal=True, color_system="standard")
    print_tables(tables, styled)
    assert "*" not in styled.file.getvalue()
