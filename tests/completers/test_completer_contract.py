"""What both classical completers promise for any cloud: the input kept, the same answer twice, no crash."""

import numpy as np
import pytest
from completer_cases import box_room, far_from
from hypothesis import given, settings
from hypothesis import strategies as st
from pcdbench_completers.hole_filling import HoleFilling
from pcdbench_completers.plane_fitting import PlaneFitting

from pcdbench import PointCloud

both = pytest.mark.parametrize("completer", [PlaneFitting(), HoleFilling()], ids=["plane_fitting", "hole_filling"])


def completed(completer, cloud, seed=0):
    return completer.complete(cloud, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def room():
    return far_from(box_room(5000), [[2.0, 2.0, 0.0], [0.0, 2.0, 1.3]], 0.6)


@both
def test_observed_points_and_colors_come_first_and_unchanged(completer, room):
    result = completed(completer, room)
    assert len(result) > len(room)
    assert np.array_equal(result.points[: len(room)], room.points)
    assert np.array_equal(result.colors[: len(room)], room.colors)


@both
def test_the_seed_decides_everything(completer, room):
    first, again, other = (completed(completer, room, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.points, again.points) and np.array_equal(first.colors, again.colors)
    assert len(first) != len(other) or not np.array_equal(first.points, other.points)


@both
def test_no_colors_in_none_out(completer, room):
    result = completed(completer, room.without_colors())
    assert result.colors is None
    assert np.array_equal(result.points, completed(completer, room).points)


@both
def test_map_coordinates_change_nothing(completer, room):
    offset = np.array([2.0**20, -(2.0**21), 64.0])
    moved = completed(completer, PointCloud(np.round(room.points, 6) + offset))
    here = completed(completer, PointCloud((np.round(room.points, 6) + offset) - offset))
    assert abs(len(moved) - len(here)) < 0.02 * len(here)
    inside = ((moved.points - offset > -0.3) & (moved.points - offset < [6.3, 4.3, 3.0])).all(axis=1)
    assert inside.all()


@both
@pytest.mark.parametrize(
    "points",
    [
        np.zeros((1, 3)),
        np.array([[0.0, 0, 0], [1, 0, 0]]),
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]),
        np.ones((500, 3)),
        np.outer(np.linspace(0, 5, 500), [1.0, 2.0, 0.5]),
        np.repeat(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), 100, axis=0),
    ],
    ids=["one", "two", "three", "duplicates", "collinear", "three_places"],
)
def test_clouds_without_a_surface_are_returned(completer, points):
    result = completed(completer, PointCloud(points, np.full(points.shape, 0.5)))
    assert np.array_equal(result.points, points)
    assert result.colors is not None and np.all(result.colors == 0.5)


@both
def test_a_gridded_plane_has_its_hole_filled_in_the_plane(completer):
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0, 4, 0.05), np.arange(0, 4, 0.05)))
    grid = PointCloud(np.column_stack([x, y, np.zeros(len(x))]))
    cut = far_from(grid, [[2.0, 2.0, 0.0]], 0.5)
    new = completed(completer, cut).points[len(cut) :]
    missing = len(grid) - len(cut)
    assert 0.6 * missing < len(new) < 1.4 * missing
    assert np.abs(new[:, 2]).max() < 1e-6
    assert np.linalg.norm(new[:, :2] - 2.0, axis=1).max() < 0.6


@both
@settings(max_examples=15, deadline=None)
@given(count=st.integers(1, 60), seed=st.integers(0, 1000), step=st.sampled_from([0.5, 1e-3, 1e3]))
def test_small_random_clouds_never_fail_nor_lose_a_point(completer, count, seed, step):
    rng = np.random.default_rng(seed)
    cloud = PointCloud(step * rng.integers(-3, 4, (count, 3)))
    result = completed(completer, cloud)
    assert np.array_equal(result.points[:count], cloud.points)
