"""The stream of training pairs: decided by seed and number, incomplete as asked, flawed as real scans are."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pcdbench.cloud import PointCloud
from pcdbench.training import augment
from pcdbench.training import truths as truths_module
from pcdbench.training.stream import PairStream, training_pair
from pcdbench.training.truths import WALK_LEVELS, Truth, training_truth

NOTHING = augment.Recipe(**dict.fromkeys((field.name for field in dataclasses.fields(augment.Recipe)), False))


def box_room(count: int = 30_000, seed: int = 0) -> Truth:
    """Six walls of 5 x 4 x 2.5 m; a walk misses the points at the far end first."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 1, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = rng.integers(0, 2, count)
    missed = np.minimum(points[:, 0] * (len(WALK_LEVELS) + 1), len(WALK_LEVELS)).astype(np.uint8)
    colors = rng.uniform(0, 1, (count, 3)).astype(np.float32)
    return Truth(PointCloud(points * (5.0, 4.0, 2.5), colors), missed)


@pytest.fixture
def box_rooms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(truths_module, "training_truth", lambda index: box_room(seed=index))


@pytest.mark.usefixtures("box_rooms")
def test_a_pair_is_decided_by_seed_and_number() -> None:
    first, again, other = PairStream(3)[7], PairStream(3)[7], PairStream(4)[7]
    assert np.array_equal(first.complete.points, again.complete.points)
    assert np.array_equal(first.kept, again.kept)
    assert len(first.complete) != len(other.complete) or not np.array_equal(first.kept, other.kept)


@pytest.mark.usefixtures("box_rooms")
def test_new_crops_keep_coming() -> None:
    stream = PairStream(0, window=3, reuse=2)
    for index in range(40):
        _ = stream[index]
    assert max(stream._truths._held) >= 15
    assert len(stream._truths._held) <= 3


def test_without_augmentation_the_truth_is_the_dense_cloud_and_the_scan_a_part_of_it() -> None:
    room = box_room()
    pair = training_pair(room, np.random.default_rng(0), NOTHING)
    assert np.array_equal(pair.truth.points, room.cloud.points)
    rows = {tuple(point) for point in room.cloud.points}
    assert all(tuple(point) in rows for point in pair.complete.points)


def test_levels_and_densities_vary_and_some_scans_are_ends_of_walks() -> None:
    room = box_room()
    pairs = [training_pair(room, np.random.default_rng(seed), NOTHING) for seed in range(40)]
    shares = [1 - pair.kept.mean() for pair in pairs]
    assert min(shares) < 0.15
    assert max(shares) > 0.45
    ends = [pair.complete.points[~pair.kept][:, 0].min() > 0.4 for pair in pairs]
    assert 3 <= sum(ends) <= 20
    dense = dataclasses.replace(NOTHING, density=True)
    counts = [len(training_pair(room, np.random.default_rng(seed), dense).complete) for seed in range(20)]
    assert max(counts) > 3 * min(counts)


def test_gaps_leave_a_third_and_ghosts_lie_beyond_the_walls() -> None:
    room = box_room()
    points = room.cloud.points
    left = [augment.natural_gaps(points, np.random.default_rng(seed)).mean() for seed in range(40)]
    assert min(left) > 1 / 3
    assert np.mean(np.array(left) < 0.95) > 0.5
    outside = 0
    for seed in range(60):
        ghosted = augment.with_ghosts(room, np.random.default_rng(seed))
        assert np.array_equal(ghosted.cloud.points[: len(points)], points)
        added = ghosted.cloud.points[len(points) :]
        if len(added):
            outside += 1
            assert not np.all((added > 0) & (added < points.max(axis=0)))
    assert 4 <= outside <= 25


def test_the_pose_keeps_shapes_up_to_one_scale() -> None:
    cloud = box_room(200).cloud
    turned = augment.reposed(cloud, np.random.default_rng(5))
    before = np.linalg.norm(cloud.points[1:] - cloud.points[0], axis=1)
    after = np.linalg.norm(turned.points[1:] - turned.points[0], axis=1)
    assert np.allclose(after / before, after[0] / before[0])
    heights = (turned.points[:, 2] - turned.points[0, 2]) * before[0]
    assert np.allclose(heights, (cloud.points[:, 2] - cloud.points[0, 2]) * after[0])


def test_a_training_truth_comes_from_the_cache_and_knows_what_walks_miss(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path))
    made, read = training_truth(0), training_truth(0)
    assert np.array_equal(made.cloud.points, read.cloud.points)
    assert np.array_equal(made.missed, read.missed)
    assert list(tmp_path.rglob("000000.npz"))
    shares = [np.mean(made.missed > len(WALK_LEVELS) - k) for k in range(1, len(WALK_LEVELS) + 1)]
    # The walk is measured on the complete cloud, which is spaced evenly; the dense cloud is not.
    assert np.allclose(shares, WALK_LEVELS, atol=0.15)
