"""One cell: what its rows hold, and that whatever goes wrong costs its own rows alone."""

import gc
import json
import weakref
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pcdbench.case import make_case
from pcdbench.errors import PluginError, Skipped
from pcdbench.runner import selection
from pcdbench.runner.completions import CompletionCache
from pcdbench.runner.execute import Executor
from pcdbench.runner.plan import Request, plan
from pcdbench.runner.rows import samples_by_metric
from pcdbench.task import Measurements, Metric

pytestmark = pytest.mark.usefixtures("tiny_plugins")


@pytest.fixture
def run_rows(tmp_path):
    """A function that runs a request in this process and gives its rows."""

    def run(*options, completers=("tiny_fill",), tasks=("tiny_gap",), levels=(0.3,), references=False, scenes=1):
        request = Request(
            completers,
            tasks,
            "tiny",
            None,
            ["slab"],
            levels,
            options=[f"tiny.scenes={scenes}", *options],
            references=references,
        )
        planned = plan(request)
        executor = Executor(planned.dataset, CompletionCache(tmp_path / "completions"))
        return [row for cell in planned.cells for row in executor.rows(cell, planned.tasks)]

    return run


def test_a_row_holds_what_was_measured_and_how(run_rows):
    (row,) = run_rows()
    assert row == json.loads(json.dumps(row, allow_nan=False))
    assert (row["status"], row["error"], row["stage"]) == ("ok", None, None)
    assert row["dataset"]["name"] == "tiny" and row["dataset"]["digest"] == row["scene"] == "box0"
    assert row["completer"]["options"] == {"points": 500, "seconds": 0.0}
    gap = row["metrics"]["gap_m"]
    assert (gap["unit"], gap["direction"], gap["summary"], gap["main"]) == ("m", "lower", "mean", True)
    assert row["metrics"]["drawn"]["labels"] == ["a", "b", "c"]
    assert row["trace"]["path"] == [[0, 0, 0], [0, 0, 0]]
    assert row["points"] == {"complete": 300, "incomplete": 210, "completed": 710}
    assert row["completing"]["seconds"] > 0 and row["completing"]["cached"] is False
    assert row["device"] == "cpu" and row["threads"] >= 1


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"weights": "0" * 64}, "the weights of tiny_fill are not those"),
        ({"code": "x"}, "the code of tiny_fill is not"),
        ({"code": "x", "options": {"gone": 1}}, "the code of tiny_fill is not"),
    ],
)
def test_what_changed_since_the_plan_is_not_measured_under_its_key(tmp_path, changed, message):
    planned = plan(Request(["tiny_fill"], ["tiny_gap"], "tiny", None, ["slab"], [0.3], references=False))
    cell = replace(planned.cells[0], completer=replace(planned.completers[0], **changed))
    (row,) = Executor(planned.dataset, CompletionCache(tmp_path)).rows(cell, planned.tasks)
    assert (row["status"], row["stage"]) == ("failed", "completing") and row["error"].startswith(message)


def test_density_is_capped_before_the_task_sees_it(run_rows):
    (row,) = run_rows()
    assert row["trace"]["count"] == row["points"]["complete"] == 300


def test_density_is_capped_whatever_the_cloud_says_of_itself(run_rows):
    (row,) = run_rows("tiny_faulty.how=posing", completers=["tiny_faulty"])
    assert row["points"]["completed"] == 9 * 210 and row["trace"]["count"] == 300


def test_a_row_tells_of_points_that_only_who_knows_the_truth_can_have(run_rows):
    knows, honest = run_rows("tiny_faulty.how=knows", completers=["tiny_faulty", "tiny_fill"])
    truth, *_ = run_rows(completers=["ground_truth"])
    assert knows["foreknown"] == 1.0
    assert "foreknown" not in honest and "foreknown" not in truth, "references are no methods"


def test_all_completers_and_levels_are_measured_with_the_same_draws(run_rows):
    rows = run_rows(completers=["tiny_fill", "tiny_colorful"], levels=(0.1, 0.5), scenes=2)
    drawn = {(row["scene"], tuple(row["metrics"]["drawn"]["samples"])) for row in rows}
    assert len(rows) == 8 and len(drawn) == 2


def test_levels_of_a_draw_are_nested(run_rows, tmp_path):
    planned = plan(Request(["tiny_fill"], ["tiny_gap"], "tiny", None, ["holes"], references=False))
    executor = Executor(planned.dataset, CompletionCache(tmp_path))
    less, more = (executor.case(cell).kept for cell in planned.cells[:2])
    assert (~less).sum() == 30 and (~more).sum() == 90
    assert (~less & ~more).sum() >= 27, "all but the last hole, which the level cuts short"


@pytest.mark.parametrize(
    ("how", "status", "error"),
    [
        ("raise", "failed", "ZeroDivisionError: no plane has been found"),
        ("exit", "failed", "SystemExit: good bye"),
        ("wrong", "failed", "the completer returned ndarray, not a pcdbench.PointCloud"),
        ("empty", "failed", "the completer returned a cloud without points"),
        ("late", "failed", "1 of 210 points are not finite; drop them before use"),
        ("skip", "skipped", "only round rooms"),
    ],
)
def test_a_completer_that_fails_costs_its_own_rows(run_rows, how, status, error):
    rows = run_rows(f"tiny_faulty.how={how}", completers=["tiny_faulty", "tiny_fill"], tasks=["tiny_gap", "tiny_color"])
    faulty = [row for row in rows if row["completer"]["name"] == "tiny_faulty"]
    assert [(row["status"], row["stage"], row["error"]) for row in faulty] == [(status, "completing", error)] * 2
    assert [row["status"] for row in rows if row not in faulty] == ["ok", "ok"]
    if how == "raise":
        assert "tiny_plugins.py" in faulty[0]["detail"]


@pytest.mark.parametrize(
    ("how", "error"),
    [
        ("nan", "1 of 2 samples of 'value' are not finite"),
        ("huge", "1 of 2 samples of 'value' are not finite, or beyond 1e+300"),
        ("undeclared", "'vaule', which its `metrics` do not declare"),
        ("shape", "must be a sequence of numbers"),
        ("text", "samples of 'value' are not numbers"),
        ("none", "the task returned NoneType, not pcdbench.Measurements"),
        ("trace", "object in the trace"),
        ("labels", "'value' has 2 samples and 1 labels"),
    ],
)
def test_a_task_that_breaks_its_contract_costs_its_own_row(run_rows, how, error):
    wrong, gap = run_rows(f"tiny_wrong.how={how}", tasks=["tiny_wrong", "tiny_gap"])
    assert (wrong["status"], wrong["stage"], wrong["metrics"]) == ("failed", "evaluating", {})
    assert error in wrong["error"]
    assert gap["status"] == "ok"


def test_a_task_that_needs_colour_skips_a_completed_cloud_without(run_rows):
    color, gap = run_rows("tiny_faulty.how=colorless", completers=["tiny_faulty"], tasks=["tiny_color", "tiny_gap"])
    assert (color["status"], color["error"]) == ("skipped", "the task needs colour and the completed cloud has none")
    assert gap["status"] == "ok"


def test_a_completer_that_needs_colour_skips_scenes_without(run_rows):
    rows = run_rows("tiny.color=false", completers=["tiny_colorful", "tiny_fill"])
    assert {row["completer"]["name"]: row["status"] for row in rows} == {"tiny_colorful": "skipped", "tiny_fill": "ok"}


def test_a_scene_that_cannot_be_made_fails_with_its_reason(run_rows):
    rows = run_rows("tiny.broken=box1", scenes=3)
    found = {row["scene"]: (row["status"], row["stage"], row["error"]) for row in rows}
    assert found["box1"] == ("failed", "scene", "box1.ply has no points; scan it again")
    assert found["box0"] == found["box2"] == ("ok", None, None)


def test_a_scene_whose_digest_raises_anything_fails_alone(run_rows, monkeypatch):
    monkeypatch.setattr("tiny_plugins.Tiny.digest", lambda self, name: {"box0": "0", "box2": "2"}[name])
    rows = run_rows(scenes=3)
    found = {row["scene"]: (row["status"], row["stage"], row["error"]) for row in rows}
    assert found["box1"] == ("failed", "scene", "KeyError: 'box1'")
    assert found["box0"] == found["box2"] == ("ok", None, None)


@pytest.mark.parametrize(
    ("reason", "error"), [(Skipped("two lines:\n  of a table"), "two lines: of a table"), (Skipped, "Skipped")]
)
def test_a_reason_is_one_line_whatever_a_plugin_says(run_rows, monkeypatch, reason, error):
    def skips(self, cloud, rng):
        raise reason

    monkeypatch.setattr("tiny_plugins.Fill.complete", skips)
    (row,) = run_rows()
    assert (row["status"], row["error"]) == ("skipped", error)


@pytest.mark.parametrize("plugin", ["Fill", "Gap"])
def test_what_cannot_be_built_keeps_no_cases(run_rows, monkeypatch, plugin):
    cases, alive = [], []

    def cannot(self, options=None):
        raise ImportError("no module named x")

    def noted(*arguments):
        gc.collect()
        alive.append(sum(case() is not None for case in cases))
        case = make_case(*arguments)
        cases.append(weakref.ref(case))
        return case

    monkeypatch.setattr(f"tiny_plugins.{plugin}.__init__", cannot)
    monkeypatch.setattr("pcdbench.runner.execute.make_case", noted)
    rows = run_rows(scenes=6)
    assert [row["error"] for row in rows] == ["ImportError: no module named x"] * 6
    assert len(alive) == 6 and max(alive) <= 2, "as many as it keeps anyhow"


def test_completions_are_cached_by_key_and_code_but_references_are_not(run_rows, tmp_path):
    first = run_rows(references=True)
    second = run_rows(references=True)
    assert [row["metrics"] for row in first] == [row["metrics"] for row in second]
    assert {row["completer"]["name"]: row["completing"]["cached"] for row in second} == {
        "ground_truth": False,
        "incomplete": False,
        "resample": False,
        "tiny_fill": True,
    }
    fill = [row["completing"]["seconds"] for row in (*first, *second) if row["completer"]["name"] == "tiny_fill"]
    assert fill[0] == fill[1], "a cached completion keeps what it cost when it was made"


@pytest.mark.parametrize("plugin", ["Tiny", "Slab", "Fill"])
def test_a_completion_made_by_code_that_has_changed_since_is_not_taken_from_the_cache(run_rows, monkeypatch, plugin):
    run_rows()
    its = selection.code_digest
    monkeypatch.setattr(selection, "code_digest", lambda cls: "other" if cls.__name__ == plugin else its(cls))
    (row,) = run_rows()
    assert row["status"] == "ok" and row["completing"]["cached"] is False


def test_memory_is_what_the_block_added():
    from pcdbench.runner.measuring import Cost

    with Cost() as small:
        np.ones(10)
    with Cost() as large:
        np.ones(20_000_000).sum()
    if large.peak_memory_mb is None:
        pytest.skip("this system does not tell peaks of memory")
    assert 150 < large.peak_memory_mb < 250 and small.peak_memory_mb < 20


def test_memory_that_was_freed_before_counts_again():
    from pcdbench.runner.measuring import Cost

    def many_blocks():
        return [bytearray(50_000) for _ in range(1000)]  # from the heap, which keeps what is freed

    before, pin = many_blocks(), bytearray(50_000)
    del before
    with Cost() as cost:
        many_blocks()
    if cost.peak_memory_mb is None:
        pytest.skip("this system does not tell peaks of memory")
    assert 40 < cost.peak_memory_mb < 70 and pin


def test_samples_are_kept_to_nine_digits():
    task = SimpleNamespace(metrics=(Metric("error_m", "m", "lower", "its meaning", "mean"),))
    kept = samples_by_metric(task, Measurements({"error_m": [1.23456789012, 1e-7 / 3]}))["metrics"]["error_m"][
        "samples"
    ]
    assert kept == [1.23456789, 3.33333333e-8]


@pytest.mark.parametrize("samples", [{}, {"error_m": []}, {"other_m": [1.0]}])
def test_without_samples_of_the_main_metric_nothing_was_measured(samples):
    task = SimpleNamespace(metrics=tuple(Metric(name, "m", "lower", "its meaning") for name in ("error_m", "other_m")))
    with pytest.raises(PluginError, match=r"no samples of .error_m.; raise pcdbench\.Skipped"):
        samples_by_metric(task, Measurements(samples))
