"""Poisson-disk subsets: exact size, spacing, evenness, determinism, odd inputs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from pcdbench.geometry.sampling import apart_indices, own_numbers, poisson_disk_indices


def spacing(points):
    return cKDTree(points).query(points, k=2)[0][:, 1]


@pytest.fixture(scope="module")
def uneven_floor():
    """A floor of 8 x 6 m and a wall, a hundred times as dense in one corner as in the other."""
    rng = np.random.default_rng(5)
    floor = rng.uniform(0, 1, (60_000, 3)) ** [2.0, 2.0, 1.0] * [8.0, 6.0, 0.0]
    wall = rng.uniform(0, 1, (20_000, 3)) * [8.0, 0.0, 3.0]
    return np.concatenate([floor, wall])


def test_spacing_is_even_where_the_source_is_not(uneven_floor):
    index = poisson_disk_indices(uneven_floor, 1500, np.random.default_rng(0))
    blue = spacing(uneven_floor[index])
    white = spacing(uneven_floor[np.random.default_rng(0).choice(len(uneven_floor), 1500, replace=False)])
    assert blue.std() / blue.mean() < 0.2 < white.std() / white.mean()
    # The densest packing of 1500 discs on 72 square metres is 0.235 m apart; dart throwing reaches 0.6 of it.
    assert blue.min() > 0.6 * 0.235
    assert cKDTree(uneven_floor[index]).query(uneven_floor)[0].max() < 1.5 * blue.min()


def test_no_regular_grid_shows(uneven_floor):
    index = poisson_disk_indices(uneven_floor, 1500, np.random.default_rng(0))
    other = poisson_disk_indices(uneven_floor, 1500, np.random.default_rng(1))
    assert len(np.intersect1d(index, other)) < 0.25 * len(index)


@settings(max_examples=40, deadline=None)
@given(
    total=st.integers(1, 400),
    count=st.integers(0, 450),
    seed=st.integers(0, 2**32),
    duplicates=st.booleans(),
    scale=st.sampled_from([1e-3, 1.0, 1e3]),
)
def test_exact_count_sorted_distinct_and_repeatable(total, count, seed, duplicates, scale):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(total, 3)) * scale + 1e5
    if duplicates:
        points = points[rng.integers(0, max(1, total // 4), total)]
    index = poisson_disk_indices(points, count, np.random.default_rng(seed))
    assert index.dtype == np.int64
    assert len(index) == min(total, count)
    assert (np.diff(index) > 0).all()
    assert not len(index) or (index[0] >= 0 and index[-1] < total)
    np.testing.assert_array_equal(index, poisson_disk_indices(points, count, np.random.default_rng(seed)))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_half_the_points_are_further_apart_than_random_ones(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(200, 3))
    index = poisson_disk_indices(points, 100, rng)
    assert pdist(points[index]).min() > 1.2 * pdist(points[rng.choice(200, 100, replace=False)]).min()


def test_clumps_do_not_blow_up():
    rng = np.random.default_rng(0)
    clump = rng.normal(0, 1e-6, (40_000, 3))
    points = np.concatenate([clump, rng.uniform(-1, 1, (4000, 3))])
    index = poisson_disk_indices(points, 4000, rng)
    assert (index >= 40_000).sum() > 2500


def test_apart_indices_are_apart_maximal_and_around_the_fixed_points():
    rng = np.random.default_rng(5)
    points = np.concatenate([rng.random((60, 3)) * [1, 1, 0.01], rng.random((900, 3)) * [1, 1, 0.01]]) + 1e6
    radius, fixed = 0.08, 60
    rows = apart_indices(points, radius, rng, fixed)
    assert (rows[:fixed] == np.arange(fixed)).all()
    assert (np.diff(rows) > 0).all()
    distances = np.linalg.norm(points[:, None] - points[rows][None], axis=2)
    distances[rows, np.arange(len(rows))] = np.inf
    assert distances[rows[fixed:]].min() >= radius, "those taken are apart from each other and from the fixed"
    rest = np.setdiff1d(np.arange(len(points)), rows)
    assert distances[rest].min(axis=1).max() < radius, "nothing more fits"
    assert len(apart_indices(points, 0.0, rng)) == len(points)
    assert len(apart_indices(points[:0], 0.1, rng)) == 0


def test_a_source_that_differs_in_a_few_points_gives_a_sample_that_differs_in_a_few(uneven_floor):
    some = np.delete(uneven_floor, [7, 20_000, 70_000], axis=0)
    samples = [
        {tuple(point) for point in source[poisson_disk_indices(source, 1500, order=np.argsort(own_numbers(source)))]}
        for source in (uneven_floor, some, uneven_floor[::-1])
    ]
    assert len(samples[0] & samples[1]) > 1450
    assert samples[0] == samples[2]


def test_who_comes_first_must_be_said():
    with pytest.raises(ValueError, match="rng or order"):
        poisson_disk_indices(np.zeros((10, 3)), 5)
