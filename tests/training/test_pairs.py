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
def test_another_seed_sees_other_rooms() -> None:
    one, other = PairStream(3, window=2), PairStream(4, window=2)
    for index in range(4):
        _ = one[index], other[index]
    assert not set(one._truths._held) & set(other._truths._held)


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


def test_stations_do_not_see_what_lies_behind_a_screen_nor_the_floor_below_a_platform() -> None:
    rng = np.random.default_rng(0)
    floor = rng.uniform(0, 1, (40_000, 3)) * (6.0, 4.0, 0.0)
    platform = rng.uniform(0, 1, (8_000, 3)) * (1.6, 1.6, 0.0) + (2.2, 1.2, 0.25)
    screen = rng.uniform(0, 1, (20_000, 3)) * (0.0, 4.0, 2.5) + (6.5, 0.0, 0.0)
    wall = rng.uniform(0, 1, (20_000, 3)) * (0.0, 4.0, 2.5) + (7.5, 0.0, 0.0)
    points = np.concatenate([floor, platform, screen, wall])
    below = np.all(np.abs(floor[:, :2] - (3.0, 2.0)) < 0.3, axis=1)
    beside = np.hypot(*(floor[:, :2] - (3.0, 2.0)).T) > 1.5
    masks = [augment.seen_from_stations(points, np.random.default_rng(seed)) for seed in range(60)]
    some = [mask for mask in masks if not mask.all()]
    assert 15 < len(some) < 35
    parts = [np.split(mask, np.cumsum([len(floor), len(platform), len(screen)])) for mask in some]
    assert np.mean([on_floor[below].mean() for on_floor, *_ in parts]) < 0.5
    assert np.mean([on_floor[beside].mean() for on_floor, *_ in parts]) > 0.9
    # A wall behind a screen: most stations stand before both.
    assert np.median([behind.mean() for *_, behind in parts]) < 0.2
    assert np.median([before.mean() for *_, before, _ in parts]) > 0.9


def test_the_floor_is_found_below_clutter_that_reaches_through_it() -> None:
    rng = np.random.default_rng(0)
    shell = rng.uniform(-0.4, 0.4, (2_000, 3)) + np.array((2.0, 2.0, 0.0))
    points = np.concatenate([box_room().cloud.points, shell])
    assert np.mean(np.abs(points[augment._floor(points), 2]) < 0.15) > 0.9


def test_notches_take_a_corner_or_a_bay_and_walls_stand_along_them() -> None:
    room = box_room()
    count = len(room.cloud)
    made = [augment.with_notch(room, np.random.default_rng(seed)) for seed in range(80)]
    cut = [its for its in made if its is not room]
    assert 15 < len(cut) < 45
    walled = 0
    for its in cut:
        assert len(its.missed) == len(its.cloud)
        assert its.cloud.colors is not None
        rows = {tuple(point) for point in room.cloud.points}
        old = np.array([tuple(point) in rows for point in its.cloud.points])
        assert count / 4 < old.sum() < count
        walls = its.cloud.points[~old]
        if len(walls):
            walled += 1
            assert np.all((walls > -1e-9) & (walls < np.array((5.0, 4.0, 2.5)) + 1e-9))
            assert np.ptp(walls[:, 2]) > 2.2
    assert 0.2 < walled / len(cut) < 0.8


def test_noise_is_of_some_millimetres_and_few_points_float() -> None:
    cloud = PointCloud(np.zeros((20_000, 3)))
    floating, rms_m = [], []
    for seed in range(30):
        moved = augment.noisy(cloud, np.random.default_rng(seed)).points
        # Ten times the largest range noise.
        far = np.linalg.norm(moved, axis=1) > 0.12
        floating.append(far.mean())
        rms_m.append(moved[~far].std())
    assert 0.001 < np.mean(floating) < 0.004 and max(floating) < 0.006
    assert min(rms_m) < 0.002 and 0.01 < max(rms_m) < 0.013


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
