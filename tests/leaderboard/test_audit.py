"""The audit's verdict on made-up rows, each comparison broken in turn."""

import json

import numpy as np
import pytest
from rows_for_tests import result_row

from pcdbench.leaderboard.audit import audits

GOOD = {
    ("ground_truth", 0.1): 1.0,
    ("resample", 0.1): 1.1,
    ("incomplete", 0.1): 2.0,
    ("incomplete", 0.3): 3.0,
    ("ground_truth", 0.5): 1.0,
    ("resample", 0.5): 1.1,
    ("incomplete", 0.5): 4.0,
}


def rows(means, spread=0.3, scenes=12, direction="lower", noise=0.02):
    rng = np.random.default_rng(0)
    base = rng.normal(scale=spread, size=scenes)
    sign = 1 if direction == "lower" else -1
    return [
        result_row(name, [sign * (mean + base[scene] + rng.normal(scale=noise))] * 2, scene=f"s{scene}", level=level,
                   direction=direction)
        for (name, level), mean in means.items()
        for scene in range(scenes)
    ]  # fmt: skip


@pytest.mark.parametrize("direction", ["lower", "higher"])
def test_a_task_that_measures_passes(direction):
    (audit,) = audits(rows(GOOD, direction=direction))
    assert audit.passed and audit.broken == [] and audit.scenes == 12 and audit.ceiling == "resample"
    assert [check.name for check in audit.checks] == [
        "ground_truth no worse than resample",
        "resample beats incomplete 10%",
        "incomplete 10% beats 30%",
        "incomplete 30% beats 50%",
        "resample apart from incomplete 50%",
    ]
    assert audit.checks[1].advantage.value == pytest.approx(0.9, abs=0.05)
    json.dumps(audit.as_json(), allow_nan=False)


@pytest.mark.parametrize(
    ("change", "broken"),
    [
        ({("ground_truth", 0.1): 1.5, ("ground_truth", 0.5): 1.5}, ["ground_truth no worse than resample"]),
        ({("incomplete", 0.1): 1.0}, ["resample beats incomplete 10%"]),
        ({("incomplete", 0.3): 1.5}, ["incomplete 10% beats 30%"]),
        ({("incomplete", 0.5): 2.5}, ["incomplete 30% beats 50%"]),
    ],
)
def test_each_broken_comparison_is_named(change, broken):
    (audit,) = audits(rows(GOOD | change))
    assert audit.broken == broken and not audit.passed


def test_an_order_without_a_gap_does_not_pass():
    (audit,) = audits(rows(GOOD, spread=8.0))
    assert audit.broken == ["resample apart from incomplete 50%"]
    assert audit.checks[-1].note == "intervals touch"


def test_a_truth_as_good_as_the_ceiling_is_a_tie():
    means = GOOD | {("ground_truth", 0.1): 1.1, ("ground_truth", 0.5): 1.1}
    (audit,) = audits(rows(means))
    assert audit.passed and audit.checks[0].note == "tie"


def test_a_blind_task_fails_all_but_the_tie():
    (audit,) = audits(rows(dict.fromkeys(GOOD, 1.0), noise=0.0))
    assert len(audit.broken) == 4


def test_without_a_second_sample_the_truth_is_the_ceiling():
    skipped = [
        result_row("resample", [], scene=f"s{scene}", level=0.5, status="skipped", error="no second sample")
        for scene in range(12)
    ]
    means = {key: value for key, value in GOOD.items() if key[0] != "resample"}
    (audit,) = audits(rows(means) + skipped)
    assert audit.passed and audit.ceiling == "ground_truth"
    assert [its.skipped for its in audit.standings if its.reference == "resample"] == [0, 0, 12]


@pytest.mark.parametrize("status", ["failed", "skipped"])
def test_a_task_without_measurements_does_not_pass(status):
    (audit,) = audits([result_row("incomplete", [], status=status, error="no floor to stand on")])
    assert not audit.passed and audit.checks[0].note == "no floor to stand on"


def test_one_scene_proves_nothing():
    (audit,) = audits(rows(GOOD, scenes=1))
    assert audit.broken == ["resample apart from incomplete 50%"]
    assert {check.note for check in audit.checks[1:-1]} == {"no interval: it takes two scenes or more"}


def test_its_intervals_are_over_environments():
    made = rows(GOOD, spread=1.0)
    parts = [row | {"dataset": {"environment": "ab"[int(row["scene"][1:]) % 2]}} for row in made]
    alone, together = audits(made)[0], audits(parts)[0]
    assert (alone.scenes, together.scenes) == (12, 12)
    both = [(one.mean, its.mean) for one, its in zip(alone.standings, together.standings, strict=True) if one.mean]
    assert len(both) == len(GOOD)
    assert all(one.value == its.value and one.low != its.low for one, its in both)
