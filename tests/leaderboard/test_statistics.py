"""Bootstrap intervals over scenes against plain loops, and what must hold for any samples."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pcdbench.leaderboard.statistics import estimates, mean_estimate, scene_weights

STATISTICS = {"median": np.median, "p90": lambda values: np.quantile(values, 0.9), "mean": np.mean}


def test_intervals_are_those_of_a_plain_bootstrap_over_scenes():
    rng = np.random.default_rng(0)
    scenes = rng.integers(0, 7, 60)
    samples = rng.gamma(2.0, size=60) + scenes
    drawn = {name: [] for name in STATISTICS}
    for weights in scene_weights(7):
        resampled = np.concatenate([np.tile(samples[scenes == scene], times) for scene, times in enumerate(weights)])
        for name, statistic in STATISTICS.items():
            drawn[name].append(statistic(resampled))
    for name, estimate in estimates(samples, scenes).items():
        assert estimate.value == pytest.approx(STATISTICS[name](samples))
        assert (estimate.low, estimate.high) == pytest.approx(np.quantile(drawn[name], [0.025, 0.975]))
    alone, among = mean_estimate(samples, scenes), estimates(samples, scenes)["mean"]
    assert (alone.value, alone.low, alone.high) == pytest.approx((among.value, among.low, among.high))


def plain_quantile(ordered, weights, share):
    """Of each resample, by counting every sample of it: ordered (n,), weights (R, n)."""
    ends = np.cumsum(weights, axis=1)
    position = (ends[:, -1] - 1) * share
    below = np.floor(position).astype(np.int64)
    ranks = (below, np.minimum(below + 1, ends[:, -1] - 1))
    low, high = (
        ordered[[np.searchsorted(end, rank, side="right") for end, rank in zip(ends, at, strict=True)]] for at in ranks
    )
    return low + (position - below) * (high - low)


@pytest.mark.parametrize(("scenes", "samples"), [(2, 2), (2, 5), (7, 40), (30, 30), (30, 2000), (150, 700)])
def test_intervals_are_to_the_last_bit_those_of_counting_every_sample(scenes, samples):
    rng = np.random.default_rng(samples)
    of_scene = rng.permutation(np.arange(samples) % scenes)
    values = rng.gamma(2.0, size=samples).round(2)
    order = np.argsort(values, kind="stable")
    weights = scene_weights(scenes)
    sums, sizes = np.bincount(of_scene[order], values[order]), np.bincount(of_scene)
    drawn = {
        "median": plain_quantile(values[order], weights[:, of_scene[order]], 0.5),
        "p90": plain_quantile(values[order], weights[:, of_scene[order]], 0.9),
        "mean": (weights @ sums) / (weights @ sizes),
    }
    for name, estimate in estimates(values, of_scene).items():
        assert (estimate.low, estimate.high) == tuple(np.quantile(drawn[name], [(1 - 0.95) / 2, (1 + 0.95) / 2]))


def test_scenes_are_drawn_with_replacement_and_the_same_each_time():
    weights = scene_weights(5)
    assert weights.shape == (1000, 5) and (weights.sum(axis=1) == 5).all()
    assert (weights == 0).any() and np.array_equal(weights, scene_weights(5))


def test_samples_of_one_scene_are_not_taken_for_independent():
    rng = np.random.default_rng(1)
    scenes = np.repeat(np.arange(10), 100)
    samples = rng.normal(size=10)[scenes] + rng.normal(scale=0.01, size=1000)
    over_scenes = mean_estimate(samples, scenes)
    over_samples = mean_estimate(samples, np.arange(1000))
    assert over_scenes.high - over_scenes.low > 5 * (over_samples.high - over_samples.low)


def test_about_95_percent_of_intervals_hold_the_mean():
    rng = np.random.default_rng(2)
    held = [mean_estimate(rng.normal(size=40), np.arange(40)) for _ in range(400)]
    assert 0.90 <= np.mean([estimate.low <= 0 <= estimate.high for estimate in held]) <= 0.98


def test_one_scene_has_no_interval():
    for estimate in estimates(np.array([1.0, 2.0, 4.0]), np.zeros(3, dtype=int)).values():
        assert not estimate.has_interval
    assert mean_estimate(np.array([1.0, 3.0]), np.zeros(2, dtype=int)).value == 2.0


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 4), st.floats(-1e3, 1e3)), min_size=2, max_size=30),
    st.floats(0.1, 10),
    st.floats(-100, 100),
)
def test_intervals_move_and_grow_with_the_samples(pairs, scale, shift):
    scenes = np.array([scene for scene, _ in pairs])
    samples = np.array([value for _, value in pairs])
    before, after = estimates(samples, scenes), estimates(samples * scale + shift, scenes)
    for name, estimate in before.items():
        moved = np.array([estimate.value, estimate.low, estimate.high]) * scale + shift
        got = [after[name].value, after[name].low, after[name].high]
        np.testing.assert_allclose(got, moved, atol=1e-6, rtol=1e-9)
        if estimate.has_interval:
            assert samples.min() - 1e-9 <= estimate.low <= estimate.high <= samples.max() + 1e-9
