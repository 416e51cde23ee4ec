"""Holes: the level is exact, every hole is a nearest set, and only the seed decides which."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pcdbench.case import make_case
from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.incompletenesses.holes import Holes
from pcdbench.scene import Scene


def scene_of(points):
    cloud = PointCloud(points)
    return Scene("test", cloud, cloud, np.arange(len(points)))


def kept_of(points, level, seed=0, **options):
    holes = Holes(Holes.Options(**options))
    return make_case(scene_of(points), "holes", holes, level, seed).kept


@given(
    count=st.integers(1, 700),
    level=st.floats(0.001, 0.999),
    share=st.floats(0.001, 1.0),
    seed=st.integers(0, 2**32),
    coarse=st.booleans(),
)
def test_removes_exactly_the_level(count, level, share, seed, coarse):
    points = np.random.default_rng(seed).uniform(0, 3, (count, 3))
    points = np.round(points) if coarse else points  # coarse: many equal distances and duplicates
    if round(level * count) == count:
        with pytest.raises(CloudError, match="none would be left"):
            kept_of(points, level, seed, share_per_seed=share)
        return
    kept = kept_of(points, level, seed, share_per_seed=share)
    assert (~kept).sum() == round(level * count)


@pytest.mark.parametrize("level", [0.1, 0.3, 0.5])
def test_published_levels_on_20000_points(level):
    points = np.random.default_rng(1).uniform(0, 5, (20_000, 3))
    assert (~kept_of(points, level)).sum() == level * 20_000


def test_first_hole_is_the_three_percent_around_one_of_its_points():
    points = np.random.default_rng(2).uniform(0, 5, (1000, 3))
    removed = np.flatnonzero(~kept_of(points, 0.03, seed=4))
    distances = np.linalg.norm(points[:, None] - points[None, removed], axis=2)
    nearest_sets = [set(np.argsort(distances[:, column])[:30]) for column in range(len(removed))]
    assert set(removed) in nearest_sets


def test_every_hole_is_the_nearest_set_of_what_was_left():
    points = np.random.default_rng(3).uniform(0, 5, (500, 3))
    before = np.ones(500, dtype=bool)
    for holes in range(1, 11):  # the same seed at a higher level digs the same holes first
        after = kept_of(points, 15 * holes / 500, seed=9)
        assert not (after & ~before).any()
        left, hole = np.flatnonzero(before), np.flatnonzero(before & ~after)
        assert len(hole) == 15
        distances = np.linalg.norm(points[left][:, None] - points[None, hole], axis=2)
        assert any(set(left[np.argsort(column)[:15]]) == set(hole) for column in distances.T)
        before = after


def test_last_hole_is_the_smaller_one():
    points = np.random.default_rng(3).uniform(0, 5, (500, 3))
    after_two, after_all = kept_of(points, 0.06, seed=5), kept_of(points, 0.07, seed=5)
    hole = np.flatnonzero(after_two & ~after_all)
    left = np.flatnonzero(after_two)
    assert len(hole) == 5
    distances = np.linalg.norm(points[left][:, None] - points[None, hole], axis=2)
    assert any(set(left[np.argsort(column)[:5]]) == set(hole) for column in distances.T)


def test_seed_decides_and_nothing_else():
    points = np.random.default_rng(6).uniform(0, 5, (2000, 3))
    np.testing.assert_array_equal(kept_of(points, 0.3, seed=1), kept_of(points, 0.3, seed=1))
    assert (kept_of(points, 0.3, seed=1) != kept_of(points, 0.3, seed=2)).any()


def test_map_coordinates_change_nothing():
    # Multiples of 2^-16 m stay exact at 10^6 m, so that the two clouds differ by the offset alone.
    points = np.round(np.random.default_rng(7).uniform(0, 5, (5000, 3)) * 2**16) / 2**16
    shifted = points + np.array([1e6, -4e6, 500.0])
    for seed in range(5):
        np.testing.assert_array_equal(kept_of(points, 0.5, seed), kept_of(shifted, 0.5, seed))


def test_duplicate_points_do_not_stop_it():
    assert (~kept_of(np.zeros((100, 3)), 0.5)).sum() == 50


def test_empty_and_one_point_clouds_are_refused():
    for count in (0, 1):
        with pytest.raises(CloudError, match=r"too few for a level of 0\.6"):
            kept_of(np.zeros((count, 3)), 0.6)


def test_share_per_seed_must_be_a_share():
    for share in (0.0, -0.1, 1.5):
        with pytest.raises(ValidationError):
            Holes.Options(share_per_seed=share)


def test_20000_points_at_half_take_a_moment():
    points = np.random.default_rng(8).uniform(0, 5, (20_000, 3))
    seconds = []  # of the processor: other programs must not fail this
    for seed in range(7):
        start = time.process_time()
        kept_of(points, 0.5, seed)
        seconds.append(time.process_time() - start)
    print(f"fastest of 7: {min(seconds) * 1000:.1f} ms")
    assert min(seconds) < 0.03
