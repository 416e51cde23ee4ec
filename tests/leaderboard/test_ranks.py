"""Ranks: who is told apart, how often wrongly, and that nobody gains by failing."""

import numpy as np
import pytest
from scipy import stats

from pcdbench.leaderboard.ranks import FEWEST_SCENES, Tried, ranking
from pcdbench.leaderboard.statistics import scene_weights


def tried(values, start=0):
    """A completer's cases, one a scene; None is a failure, a list are samples of one case."""
    samples = [() if value is None else tuple(np.atleast_1d(value)) for value in values]
    return [Tried(start + number, f"scene{number}", its) for number, its in enumerate(samples)]


@pytest.fixture
def scenes():
    """Thirty scenes that differ more from one another than completers do."""
    return np.random.default_rng(0).gamma(1.0, 10.0, 30)


@pytest.mark.parametrize(("direction", "expected"), [("lower", [1, 2]), ("higher", [2, 1])])
@pytest.mark.parametrize("statistic", ["mean", "median"])
def test_a_small_difference_in_every_scene_is_told(scenes, direction, expected, statistic):
    ranks = ranking({"a": tried(scenes), "b": tried(scenes * 1.05 + 0.2)}, {}, direction, statistic).ranks
    assert [ranks["a"], ranks["b"]] == expected


def test_those_that_cannot_be_told_apart_share_a_rank_and_the_next_comes_after_all_that_beat_it(scenes):
    rng = np.random.default_rng(1)
    alike = {name: tried(scenes + rng.normal(scale=0.5, size=30)) for name in ("a", "b", "c")}
    found = ranking(alike | {"worse": tried(scenes + 5 + rng.normal(scale=0.5, size=30))}, {}, "lower", "mean")
    assert found.ranks == {"a": 1, "b": 1, "c": 1, "worse": 4}
    assert {its.better for its in found.differences} == {None, "a", "b", "c"}
    for its in found.differences:
        told_apart = not its.difference.low <= 0 <= its.difference.high
        assert told_apart == (its.better is not None)
        assert its.cases == 30


def test_the_value_of_a_difference_is_that_of_the_tables_statistics(scenes):
    other = scenes[::-1].copy()
    for statistic, value in (("mean", np.mean), ("median", np.median)):
        ((its),) = ranking({"a": tried(scenes), "b": tried(other + 1)}, {}, "lower", statistic).differences
        assert its.difference.value == pytest.approx(value(scenes) - value(other + 1))


def test_an_interval_has_students_tails_as_far_out_as_it_reaches():
    apart = np.array([0.3, -0.1, 0.5, 0.2, -0.4, 0.6])
    (its,) = ranking({"a": tried(10 + apart), "b": tried([10.0] * 6)}, {}, "lower", "mean").differences
    drawn = scene_weights(6) @ apart / 6
    spreads = np.quantile(np.abs(drawn - apart.mean()), 0.95) / drawn.std()
    # Of 6 scenes a sample's spread is sqrt(6 / 5) times theirs, and t has 5 degrees of freedom.
    half = drawn.std() * np.sqrt(6 / 5) * stats.t.ppf(stats.norm.cdf(spreads), 5)
    value = apart.mean()
    assert (its.difference.low, its.difference.high) == pytest.approx((value - half, value + half), rel=1e-6)


def test_with_few_scenes_nobody_is_told_apart():
    for count, last in ((FEWEST_SCENES - 1, 1), (FEWEST_SCENES, 2)):
        values = np.arange(count, dtype=float)
        assert ranking({"a": tried(values), "b": tried(values + 100)}, {}, "lower", "mean").ranks == {"a": 1, "b": last}


def test_equals_are_equal(scenes):
    found = ranking({"a": tried(scenes), "b": tried(scenes)}, {}, "lower", "mean")
    assert found.ranks == {"a": 1, "b": 1} and found.differences[0].better is None


def test_rounding_of_what_is_the_same_in_every_scene_widens_no_interval(scenes):
    def half_widths(value):
        other = scenes[:12] + 1.3
        tables = {"a": [0.0] * 12, "b": [value] * 12, "c": other, "d": other * 1.05}
        found = ranking({name: tried(its) for name, its in tables.items()}, {}, "lower", "mean")
        assert found.ranks == {"a": 1, "b": 2, "c": 3, "d": 4}
        return [its.difference.high - its.difference.value for its in found.differences]

    assert half_widths(0.16) == pytest.approx(half_widths(0.25), rel=1e-9, abs=1e-9), "0.25 adds up exactly"


@pytest.mark.parametrize(("direction", "sign"), [("lower", 1), ("higher", -1)])
def test_failing_on_the_hardest_cases_does_not_help(scenes, direction, sign):
    hard = np.sort(scenes)[::-1] if direction == "lower" else np.sort(scenes)
    values = hard * 1.0
    fails = [None if number < 10 else value * (1 - 0.01 * sign) for number, value in enumerate(values)]
    honest = tried(values * (1 + 0.001 * sign))
    found = ranking({"honest": honest, "fails": tried(fails)}, {"floor": tried(values)}, direction, "mean")
    assert found.ranks["honest"] <= found.ranks["fails"]
    assert sign * found.differences[0].difference.value < 0
    alone = np.array([value for value in fails if value is not None])
    assert sign * (alone.mean() - values.mean()) < 0, "though its own average is the better one"


@pytest.mark.parametrize("failing", [True, False])
def test_intervals_that_are_wide_for_want_of_cases_bring_nobody_to_the_front(scenes, failing):
    rng = np.random.default_rng(2)
    values = scenes * np.exp(rng.normal(scale=0.02, size=30))
    worse = values * np.exp(rng.normal(0.3, 0.2, 30))
    whole = {"best": tried(values), "alike": tried(scenes)}
    assert ranking(whole | {"worse": tried(worse)}, {}, "lower", "median").ranks == {"best": 1, "alike": 1, "worse": 3}
    hard = np.argsort(worse)[30 - 14 :]
    if failing:
        fewer = tried([None if number in hard else value for number, value in enumerate(worse)])
    else:
        fewer = [one for one in tried(worse) if one.case not in hard]
    found = ranking(whole | {"worse": fewer}, {"floor": tried(scenes + 50)}, "lower", "median")
    assert [its.better for its in found.differences] == [None] * 3, "it is not told apart any more"
    assert found.ranks == {"best": 1, "alike": 1, "worse": 3}


def test_a_failure_counts_with_as_many_samples_as_others_have_there():
    several = [[1.0, 2.0, 3.0]] * 7
    found = ranking(
        {"a": tried(several), "b": tried([None, *several[1:]])}, {"floor": tried([9.0] * 7)}, "lower", "mean"
    )
    assert found.differences[0].difference.value == pytest.approx(2.0 - (3 * 9.0 + 6 * 6.0) / 21)


def test_leaving_out_the_hardest_scenes_does_not_help(scenes):
    whole = {"a": tried(scenes), "b": tried(scenes * 1.05 + 0.2)}
    mixed = tried(np.where(np.arange(30) < 8, scenes / 5, scenes * 2 + 5))
    assert ranking(whole | {"c": mixed}, {}, "lower", "mean").ranks == {"a": 1, "b": 2, "c": 3}
    found = ranking(whole | {"c": mixed[:8]}, {}, "lower", "mean")
    assert found.ranks == {"a": 1, "b": 2, "c": 3}
    assert [its.better for its in found.differences] == ["a", "c", "c"]  # in the scenes that both were tried on


def test_only_cases_that_both_were_tried_on_count(scenes):
    part = [Tried(one.case, one.scene, one.samples) for one in tried(scenes) if one.case >= 10]
    found = ranking({"a": tried(np.r_[scenes[:10] * 100, scenes[10:]]), "b": part}, {}, "lower", "mean")
    assert found.differences[0].cases == 20 and found.differences[0].difference.value == 0
    assert ranking({"a": tried([1.0], start=0), "b": tried([1.0], start=1)}, {}, "lower", "mean").ranks == {}


def test_who_was_tried_on_little_takes_nothing_from_the_others_and_has_no_rank(scenes):
    whole = {"best": tried(scenes), "worse": tried(scenes * 1.05 + 0.2)}
    found = ranking(whole | {"few": tried(scenes[:5] / 9)}, {}, "lower", "mean")
    assert found.ranks == {"best": 1, "worse": 2} == ranking(whole, {}, "lower", "mean").ranks
    assert [its.cases for its in found.differences] == [30, 5, 5]
    half = ranking(whole | {"half": tried(scenes[:15] * 1.2 + 1)}, {}, "lower", "mean")
    assert half.ranks == {"best": 1, "worse": 2, "half": 3}
    by_pair = {(its.first, its.second): its for its in half.differences}
    assert by_pair["best", "half"].difference.value == pytest.approx(-scenes[:15].mean() * 0.2 - 1)
    few = ranking({name: its[:5] for name, its in whole.items()} | {"two": tried(scenes[:2])}, {}, "lower", "mean")
    assert few.ranks == {"best": 1, "worse": 1}


def test_pairs_of_other_scenes_are_independent_however_alike_their_values(scenes):
    pair = {"a": tried(scenes), "b": tried(scenes * 1.05 + 0.2)}
    other = {
        f"other {name}": [Tried(its.case + 30, f"x{its.scene}", its.samples) for its in of] for name, of in pair.items()
    }
    alone, *_ = ranking(pair, {}, "lower", "mean").differences
    both = ranking(pair | other, {}, "lower", "mean").differences
    assert len(both) == 2 and all(its.difference.low < alone.difference.low for its in both)


def test_alike_completers_of_other_scenes_are_seldom_told_apart():
    rng = np.random.default_rng(4)
    ends = (30, 30, 20, 20, 10, 7)
    wrong = 0
    for _ in range(60):
        scenes = rng.gamma(1.0, size=30)
        values = [scenes * np.exp(rng.normal(scale=0.3, size=30)) for _ in range(6)]
        tables = {name: tried(its)[:end] for name, its, end in zip("abcdef", values, ends, strict=True)}
        wrong += any(its.better for its in ranking(tables, {}, "lower", "mean").differences)
    assert wrong <= 8, "of 60 tables; 3 are meant"


def test_who_measured_nothing_has_no_rank(scenes):
    found = ranking({"a": tried(scenes), "b": tried([None] * 30)}, {}, "lower", "mean")
    assert found.ranks == {"a": 1} and found.differences == ()
    assert ranking({"b": tried([None] * 3)}, {}, "lower", "mean").ranks == {}


@pytest.mark.parametrize("statistic", ["mean", "median"])
@pytest.mark.parametrize("count", [6, 12, 30])
def test_alike_completers_are_seldom_told_apart(count, statistic):
    rng = np.random.default_rng(3)
    wrong = 0
    for _ in range(100):
        scenes = rng.gamma(1.0, size=count)
        alike = {name: tried(scenes * np.exp(rng.normal(scale=0.3, size=count))) for name in "abcdefgh"}
        wrong += any(its.better for its in ranking(alike, {}, "lower", statistic).differences)
    assert wrong <= 12, "of 100 tables with 28 pairs each; 5 are meant"
