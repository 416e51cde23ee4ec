"""The gate: planted regressions are found, and a change that changes nothing passes, every time."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from executor_for_tests import InThisProcess
from runs_for_tests import full_row, store_run

from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.board_file import read_board, write_board
from pcdbench.leaderboard.building import board_of_runs
from pcdbench.leaderboard.gate import Finding, Verdict, _rejected_by_holm, check
from pcdbench.leaderboard.gate_report import verdict_junit, verdict_markdown, verdict_text
from pcdbench.plugins import registry
from pcdbench.runner.plan import Request, plan
from pcdbench.runner.run import carry_out

TINY = Path(__file__).parents[1] / "tiny"
CHANGING = Path(__file__).parents[1] / "changing"
REQUEST = Request(
    ["changing_fill"], ["changing_gap", "changing_voxels"], "tiny", None, ["slab"], [0.3], options=["tiny.scenes=8"]
)


@pytest.fixture
def measure(tmp_path, monkeypatch):
    """A function that measures the board anew, with something planted."""
    for folder in (TINY, CHANGING):
        monkeypatch.syspath_prepend(folder)
    monkeypatch.setattr("pcdbench.runner.run.calibration_seconds", lambda: 1.0)
    monkeypatch.setattr("pcdbench.runner.run.provenance", dict)
    monkeypatch.setattr("os.fsync", lambda descriptor: None)
    registry.cache_clear()
    import changing_plugins

    count = iter(range(1000))

    def measured(request=REQUEST, **planted):
        monkeypatch.setattr(changing_plugins, "planted", changing_plugins.Planted(**planted))
        folder = tmp_path / str(next(count))
        carry_out(plan(request), folder, InThisProcess())
        return board_of_runs("board", [folder])

    yield measured
    registry.cache_clear()
    sys.modules.pop("changing_plugins", None)


def kinds(verdict):
    return {(its.kind, its.completer, its.task) for its in verdict.findings}


def test_a_null_change_passes_twenty_times_out_of_twenty(measure):
    committed = measure()
    for number in range(20):
        verdict = check(committed, measure(seconds=0.02 + 0.001 * number))
        assert verdict.holds and not verdict.findings, verdict_text(verdict)
        assert verdict.cases == 8 and len(verdict.compared) == 8


def test_a_completer_that_drops_two_percent_of_its_points_is_worse(measure):
    verdict = check(measure(), measure(drop=0.02))
    assert not verdict.holds
    assert ("worse", "changing_fill", "changing_gap") in kinds(verdict)
    assert {its.completer for its in verdict.findings} == {"changing_fill"}


def test_what_was_worse_gets_better(measure):
    verdict = check(measure(drop=0.02), measure())
    assert verdict.holds and ("better", "changing_fill", "changing_gap") in kinds(verdict)


def test_a_task_whose_voxel_changed_is_no_result_of_completers(measure):
    verdict = check(measure(), measure(voxel_m=0.3))
    assert not verdict.holds
    assert kinds(verdict) >= {("changed", "incomplete", "changing_voxels")}
    assert {its.task for its in verdict.findings} == {"changing_voxels"}
    assert {its.kind for its in verdict.findings} == {"changed"}, "completers are not blamed for it"


def test_a_completer_three_times_slower_is_slower_and_nothing_else(measure):
    verdict = check(measure(), measure(seconds=0.09))
    assert kinds(verdict) == {("slower", "changing_fill", "")}
    assert check(measure(seconds=0.09), measure()).holds


def test_other_draws_of_the_same_completer_are_no_regression(measure):
    committed = measure(noise=0)
    for noise in range(1, 6):
        verdict = check(committed, measure(noise=noise))
        assert verdict.holds, verdict_text(verdict)


def test_a_task_or_data_set_of_another_version_asks_for_a_new_board(measure, monkeypatch):
    import changing_plugins

    committed = measure()
    monkeypatch.setattr(changing_plugins.Voxels, "version", "2")
    verdict = check(committed, measure())
    assert kinds(verdict) == {("changed", "", "changing_voxels")}
    assert "version 2, the board's is version 1; build the board again" in verdict_text(verdict)
    other_data = replace(REQUEST, options=["tiny.scenes=8", "tiny.points=299"])
    monkeypatch.setattr(changing_plugins.Voxels, "version", "1")
    verdict = check(committed, measure(other_data))
    assert kinds(verdict) == {("changed", "", "")} and "points=299" in verdict_text(verdict)


@contextmanager
def raised(text: str) -> Iterator[None]:
    with pytest.raises(PcdbenchError, match=text):
        yield


def rows(completer="a", value=1.0, count=6, **more):
    return [full_row(completer, [value * (1 + number)], scene=f"room{number}", **more) for number in range(count)]


def board(tmp_path, its, **more):
    return board_of_runs("board", [store_run(tmp_path, its, **more)])


def test_a_case_that_fails_now_is_a_regression_and_one_that_is_mended_is_not(tmp_path):
    fine, broken = rows(), [*rows()[:5], full_row("a", scene="room5", status="timeout", error="600 s")]
    good, bad = board(tmp_path / "good", fine), board(tmp_path / "bad", broken)
    verdict = check(good, bad)
    assert kinds(verdict) == {("failed", "a", "task")}
    assert "task of a: 1 of 6 cases timeout: room5: 600 s" in verdict_text(verdict)
    assert kinds(check(bad, good)) == {("repaired", "a", "task")} and check(bad, good).holds


def test_of_two_versions_on_a_board_each_is_compared_with_itself(tmp_path):
    old = store_run(tmp_path / "old", rows(value=1.0, version="9"), time="2026-01-01T00:00:00Z")
    new = store_run(tmp_path / "new", rows(value=1.5, version="10"), time="2026-01-02T00:00:00Z")
    committed = board_of_runs("board", [old, new])
    again = check(committed, board_of_runs("board", [new]))
    assert again.holds and "a (version 9) is on the board and was not run" in verdict_text(again)
    assert kinds(check(committed, board(tmp_path / "worse", rows(value=1.6, version="10")))) == {
        ("worse", "a (version 10)", "task"),
        ("note", "a (version 9)", ""),
    }
    next_one = check(committed, board(tmp_path / "next", rows(value=1.6, version="11")))
    assert ("worse", "a (version 10)", "task") in kinds(next_one), "the one that was measured last stands for both"
    other_weights = board(tmp_path / "w", rows(weights="1" * 64) + rows(value=2.0, weights="2" * 64))
    assert check(other_weights, other_weights).findings == ()


def test_time_is_a_ratio_to_the_calibration_job(tmp_path):
    committed = board(tmp_path / "one", rows(seconds=1.0), calibration=1.0)
    slow_machine = board(tmp_path / "two", rows(seconds=4.0), calibration=4.0)
    assert check(committed, slow_machine).findings == ()
    assert kinds(check(committed, board(tmp_path / "three", rows(seconds=4.0), calibration=1.0))) == {
        ("slower", "a", "")
    }
    unknown = check(committed, board(tmp_path / "four", rows(seconds=4.0), calibration=None))
    assert unknown.holds and "a has no times to compare" in verdict_text(unknown)


def test_times_from_the_cache_are_no_times_of_the_run(tmp_path):
    committed = board(tmp_path / "one", rows(seconds=1.0), calibration=1.0)
    kept = rows(seconds=1.0)
    for row in kept:
        row["completing"]["cached"] = True
    fresh = board(tmp_path / "two", kept, calibration=0.3)
    verdict = check(committed, fresh)
    assert verdict.holds and "a has no times to compare" in verdict_text(verdict)
    write_board(fresh, tmp_path / "leaderboard.json")
    assert check(committed, read_board(tmp_path)) == verdict


def test_another_processor_makes_slower_only_what_it_cannot_explain(tmp_path):
    committed = board(tmp_path / "one", rows(seconds=1.0), cpu="of a make")
    blurred = check(committed, board(tmp_path / "two", rows(seconds=4.0), cpu="of another"))
    assert kinds(blurred) == {("note", "a", "")} and blurred.holds
    assert "another processor (of a make; here: of another): no regression below 6 times" in verdict_text(blurred)
    assert kinds(check(committed, board(tmp_path / "three", rows(seconds=7.0), cpu="of another"))) == {
        ("slower", "a", "")
    }


def test_a_raised_version_is_compared_and_so_are_other_options_of_the_only_one(tmp_path):
    committed = board(tmp_path / "one", rows())
    assert check(committed, board(tmp_path / "two", rows(version="2"))).compared == (("a", "task"),)
    verdict = check(committed, board(tmp_path / "three", rows(value=1.5, options={"x": 1})))
    assert kinds(verdict) == {("worse", "a", "task"), ("note", "a", "")}


def test_higher_is_better_where_it_is(tmp_path):
    committed = board(tmp_path / "one", rows(direction="higher"))
    assert kinds(check(committed, board(tmp_path / "two", rows(value=0.9, direction="higher")))) == {
        ("worse", "a", "task")
    }


def on_two(tmp_path, name, small, count=6):
    """A board of two data, the values of the second far smaller."""
    store_run(tmp_path / name / "large", rows(value=1000.0), split="large")
    store_run(tmp_path / name / "small", rows(value=small, count=count), split="small")
    return board_of_runs("board", [tmp_path / name])


def test_each_data_set_is_compared_by_itself(tmp_path):
    worse = check(on_two(tmp_path, "one", 1.0), on_two(tmp_path, "two", 1.3))
    (finding,) = worse.findings
    assert finding.kind == "worse"
    assert (
        finding.told
        == "error_m (task) of a on rooms small: worse by 30.00% of its mean (3.5) over 6 cases, in 6 of them"
    )


def test_a_data_set_of_too_few_cases_is_told(tmp_path):
    few = check(on_two(tmp_path, "one", 1.0, count=3), on_two(tmp_path, "two", 1.3, count=3))
    assert few.holds and "of a on rooms small were not compared: 3 cases, and 4 are needed" in verdict_text(few)


def test_a_reference_that_differs_in_a_few_cases_is_told_and_no_regression(tmp_path):
    committed = board(tmp_path / "one", rows("incomplete", count=10))
    few, many = rows("incomplete", count=10), rows("incomplete", count=10, value=1.01)
    few[2:5] = many[2:5]
    verdict = check(committed, board(tmp_path / "two", few))
    told = "note: error_m (task) of the reference incomplete differs in 3 of 10 cases"
    assert verdict.holds and verdict_text(verdict).startswith(told)
    assert kinds(check(committed, board(tmp_path / "three", many))) == {("changed", "incomplete", "task")}


def test_a_reference_that_differs_in_one_of_several_data_sets_or_levels_is_measured_otherwise(tmp_path):
    def made(name, values, levels, sizes):
        for split, value in values.items():
            its = [
                full_row("incomplete", [factor * value * (number + 1)], scene=f"room{number}", level=level)
                for level, factor in levels.items()
                for number in range(sizes[split])
            ]
            store_run(tmp_path / name / split, its, split=split)
        return board_of_runs("board", [tmp_path / name])

    sizes, three = {"one": 6, "two": 20}, {0.1: 1.0, 0.3: 1.0, 0.5: 1.0}
    committed = made("committed", {"one": 1.0, "two": 1.0}, three, sizes)
    of_set = check(committed, made("set", {"one": 1.5, "two": 1.0}, three, sizes))
    of_level = check(committed, made("level", {"one": 1.0, "two": 1.0}, three | {0.5: 1.5}, sizes))
    for verdict, told in ((of_set, "18 of 78"), (of_level, "26 of 78")):
        assert kinds(verdict) == {("changed", "incomplete", "task")} and told in verdict_text(verdict)
    few = {"one": 3, "two": 20}
    verdict = check(
        made("small", {"one": 1.0, "two": 1.0}, {0.3: 1.0}, few), made("one", {"one": 1.5, "two": 1.0}, {0.3: 1.0}, few)
    )
    assert ("note", "incomplete", "task") in kinds(verdict) and verdict.holds


def test_tables_that_were_not_run_are_told(tmp_path):
    verdict = check(board(tmp_path / "one", rows() + rows(task="other")), board(tmp_path / "two", rows()))
    assert "1 of the board's 2 tables were not run, other of rooms test (holes, 30%) for one" in verdict_text(verdict)


def test_a_metric_without_values_is_no_metric_that_holds(tmp_path):
    floor = rows("incomplete", 5.0)
    committed = board(tmp_path / "one", floor + rows())
    emptied = [full_row("a", scene=f"room{number}") for number in range(6)]
    verdict = check(committed, board(tmp_path / "two", floor + emptied))
    assert kinds(verdict) == {("failed", "a", "task")}
    assert "error_m (task) of a: 6 of 6 cases have no value any more: room0 is the first" in verdict_text(verdict)
    renamed = rows("incomplete", 5.0, metric="other_m") + rows(value=9.0, metric="other_m")
    verdict = check(committed, board(tmp_path / "three", renamed))
    assert kinds(verdict) == {("changed", "incomplete", "task")}
    assert "differs in 6 of 6 cases (6 have no value any more): what is measured" in verdict_text(verdict)


def test_a_metric_that_means_something_else_asks_for_a_new_board(tmp_path):
    verdict = check(board(tmp_path / "one", rows()), board(tmp_path / "two", rows(direction="higher")))
    assert kinds(verdict) == {("changed", "", "task")}
    assert (
        "error_m of task task is the main metric, higher is better, by its mean, the board's is the main metric, "
        "lower is better, by its mean; raise the task's version"
    ) in verdict_text(verdict)


def test_what_is_on_one_board_alone_is_told(tmp_path):
    verdict = check(board(tmp_path / "one", rows() + rows("b")), board(tmp_path / "two", rows() + rows("c")))
    assert verdict.holds
    assert {its.told for its in verdict.findings} == {"b is on the board and was not run", "c is not on the board"}


def test_a_run_of_none_of_the_boards_methods_holds_nothing(tmp_path):
    floor = rows("incomplete", 5.0)
    committed = board(tmp_path / "one", floor + rows("a") + rows("b"))
    with raised(r"the run has none of the completers of the board board \(a, b\); run one of them"):
        check(committed, board(tmp_path / "two", floor + rows("renamed")))
    assert check(board(tmp_path / "three", floor), board(tmp_path / "four", floor)).holds


def test_too_few_common_cases_are_an_error(tmp_path):
    with raised("has 3 cases of the board board, and a check needs 4"):
        check(board(tmp_path / "one", rows()), board(tmp_path / "two", rows(count=3)))


def test_changes_too_small_to_matter_and_those_of_one_case_in_many_are_none(tmp_path):
    committed = board(tmp_path / "one", rows(count=12))
    assert check(committed, board(tmp_path / "two", rows(value=1.0005, count=12))).holds
    spoiled = rows(count=12)
    spoiled[3] = full_row("a", [4.5], scene="room3")
    assert check(committed, board(tmp_path / "three", spoiled)).holds


def test_significance_is_shared_by_all_that_changed(tmp_path):
    # Worse by 7.5 and 12.5 % in two cases each: t = sqrt(3) / 0.25 with three degrees of freedom, p = 0.0031.
    # Half of the significance, 0.005, is more than that; a half of the half, where two have changed, is not.
    def measured(folder, **changed):
        values = {name: changed.get(name, (1.0,) * 4) for name in "ab"}
        its = [
            full_row(name, [value], scene=f"room{number}") for name in "ab" for number, value in enumerate(values[name])
        ]
        return board(tmp_path / folder, its)

    worse = (1.075, 1.075, 1.125, 1.125)
    committed = measured("committed")
    assert kinds(check(committed, measured("one", a=worse))) == {("worse", "a", "task")}
    assert kinds(check(committed, measured("two", a=worse, b=worse))) == set()


def test_each_that_falls_leaves_its_share_to_those_after_it():
    # By Holm's method the least may be 0.005 / 4, the next 0.005 / 3 and so on, up to the first that is more.
    assert _rejected_by_holm([0.0024, 0.0012, 0.0051, 0.0016]) == [0, 1, 3]
    assert _rejected_by_holm([0.0024, 0.0012, 0.0026, 0.0017]) == [1]


def test_seldom_a_false_alarm_over_many_metrics(tmp_path):
    rng = np.random.default_rng(0)
    values = rng.gamma(2.0, size=(10, 12))

    def noisy(folder):
        its = [
            full_row(f"c{number}", [value * rng.lognormal(0, 0.2)], scene=f"room{scene}")
            for number, of in enumerate(values)
            for scene, value in enumerate(of)
        ]
        return board(tmp_path / folder, its)

    committed = noisy("committed")
    alarms = [not check(committed, noisy(f"run{number}")).holds for number in range(20)]
    assert sum(alarms) <= 1, "of 20 checks of 10 completers each; 0.2 are meant"


def test_the_reports_say_the_same():
    findings = (
        Finding("worse", "a<b>", "ssim", "ssim of a<b>: worse | by *3 %*"),
        Finding("slower", "a<b>", "", "a<b> takes 3 times"),
        Finding("better", "c", "ssim", "c is better"),
    )
    verdict = Verdict("rooms", 6, (("a<b>", "ssim"), ("a<b>", "chamfer"), ("c", "ssim")), findings)
    text, page = verdict_text(verdict), verdict_markdown(verdict)
    assert text.splitlines()[0].startswith("worse: ssim of a<b>") and "2 regressions" in text.splitlines()[-1]
    assert "❌" in page and "**Worse**\n\n- ssim of a&lt;b&gt;: worse \\| by \\*3 %\\*" in page and "**Better**" in page
    suite = ElementTree.fromstring(verdict_junit(verdict).partition("\n")[2])
    cases = {(its.get("classname"), its.get("name")): its.find("failure") for its in suite}
    assert (suite.get("tests"), suite.get("failures"), len(cases)) == ("5", "2", 5)
    assert cases["rooms.a<b>", "ssim"].get("message") == findings[0].told
    assert cases["rooms.a<b>", "time"].get("type") == "slower" and cases["rooms.c", "ssim"] is None
    holds = replace(verdict, findings=findings[2:])
    assert holds.holds and "✅" in verdict_markdown(holds) and 'failures="0"' in verdict_junit(holds)


def test_what_xml_forbids_is_left_out_of_it():
    told = "a: \x1b[31mred\x1b[0m\x00\ud800\uffff,\ttab, é, 🪑"
    verdict = Verdict("rooms", 6, (), (Finding("failed", "a\x1b", "ssim", told),))
    (case,) = ElementTree.fromstring(verdict_junit(verdict).partition("\n")[2])
    failure = case.find("failure")
    assert case.get("classname") == "rooms.a"
    assert failure.get("message") == failure.text == "a: [31mred[0m,\ttab, é, 🪑"
