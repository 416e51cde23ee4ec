"""Free space: clearance against brute force, walks that keep it, floors that must have been seen."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pcdbench.errors import Skipped
from pcdbench.geometry.freespace import (
    BODY_RADIUS_M,
    CELL_M,
    FreeSpace,
    floor_height,
    free_space,
    headings,
    points_on_triangles,
)


def floor(width=4.0, depth=3.0, spacing=0.04):
    x, y = np.meshgrid(np.arange(0, width, spacing), np.arange(0, depth, spacing))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def wall(x, depth=3.0, lower=0.0, upper=2.5, spacing=0.04):
    y, z = np.meshgrid(np.arange(0, depth, spacing), np.arange(lower, upper, spacing))
    return np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1)


def test_a_wall_with_a_door_leaves_both_rooms_and_the_walk_keeps_its_distance():
    gap = wall(2.0)
    gap = gap[(gap[:, 1] < 1.0) | (gap[:, 1] > 2.0)]
    scan = np.concatenate([floor(), gap])
    space = free_space(scan, scan)
    assert space.centers[:, 0].min() < 1 and space.centers[:, 0].max() > 3
    rng = np.random.default_rng(0)
    for _ in range(10):
        path = space.walk(5.0, 0.02, rng)
        distances = np.linalg.norm(path[:, None] - gap[None, gap[:, 2] > 0.1, :2], axis=2)
        assert distances.min() >= BODY_RADIUS_M
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 0.02 + 1e-9
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() > 2.5


def test_a_closed_wall_leaves_the_larger_room():
    scan = np.concatenate([floor(), wall(1.2)])
    assert free_space(scan, scan).centers[:, 0].min() > 1.2 + BODY_RADIUS_M - 1e-9


@pytest.mark.parametrize(("lower", "upper", "stops"), [(0.0, 0.05, False), (2.0, 2.5, False), (0.7, 0.75, True)])
def test_only_what_is_between_ankle_and_head_stops_one(lower, upper, stops):
    scan = np.concatenate([floor(), wall(2.0, lower=lower, upper=upper, spacing=0.02)])
    assert (free_space(scan, scan).centers[:, 0].min() > 1.9) == stops


def test_nobody_stands_where_no_floor_was_seen():
    seen = floor(2.0)
    outside = np.array([[4.0, 3.0, 2.4]])
    assert free_space(seen, np.concatenate([seen, outside])).centers[:, 0].max() < 2.5


def test_a_full_room_is_skipped():
    scan = np.concatenate([floor(), *(wall(x) for x in np.arange(0, 4, 0.3))])
    with pytest.raises(Skipped, match="no free space"):
        free_space(scan, scan)


def test_the_floor_is_the_fullest_low_layer():
    rng = np.random.default_rng(0)
    walls = rng.uniform([0, 0, 3], [4, 3, 5.5], (3000, 3))
    stray = np.array([[1.0, 1.0, 2.0]])
    assert floor_height(np.concatenate([floor() + np.array([0, 0, 3.0]), walls, stray])) == pytest.approx(3.0, abs=0.01)


@given(st.lists(st.floats(-3, 3), min_size=9, max_size=9))
@settings(max_examples=50, deadline=None)
def test_points_on_a_triangle_lie_on_it_and_leave_no_gap(numbers):
    corners = np.array(numbers).reshape(1, 3, 3)
    points = points_on_triangles(corners, 0.1)
    start, u, v = corners[0, 0], corners[0, 1] - corners[0, 0], corners[0, 2] - corners[0, 0]
    rng = np.random.default_rng(0)
    a, b = rng.random((2, 100))
    a, b = np.where(a + b > 1, [1 - a, 1 - b], [a, b])
    anywhere = start + a[:, None] * u + b[:, None] * v
    assert np.linalg.norm(anywhere[:, None] - points[None], axis=2).min(axis=1).max() <= 0.1
    plane = np.cross(u, v)
    if np.linalg.norm(plane) > 1e-3:
        assert np.abs((points - start) @ plane / np.linalg.norm(plane)).max() < 1e-9


def test_corners_are_rounded_no_more_than_the_clearance_allows():
    """A corner in a band of 20 cm in which a body has room: a Gaussian of 40 cm leaves it, one of 20 cm does not."""
    steps = np.arange(0.5, 2.5, 0.01)
    path = np.concatenate([np.stack([steps, steps * 0 + 0.5], 1), np.stack([steps * 0 + 2.5, steps], 1)])
    x, y = np.meshgrid(*(2 * [(np.arange(60) + 0.5) * CELL_M]), indexing="ij")
    band = np.minimum(np.abs(x - 2.5), np.abs(y - 0.5)) < 0.1
    space = FreeSpace(np.zeros(2), band, np.where(band, 0.3, 0.2), 0.0)
    smooth = space._smoothed(path)
    assert space.clearance_at(smooth).min() == 0.3
    # Each coordinate's ramp is cut by sigma / sqrt(2 pi).
    assert np.abs(smooth - path).max() == pytest.approx(0.2 / np.sqrt(2 * np.pi), abs=0.01)
    nowhere = FreeSpace(np.zeros(2), band, np.full(band.shape, 0.2), 0.0)
    assert (nowhere._smoothed(path) == path).all()


def test_headings_look_where_the_path_goes_and_hold_at_its_end():
    path = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2]], float)
    assert np.degrees(headings(path, lookahead=1)) == pytest.approx([0, 0, 90, 90, 90])


@pytest.mark.parametrize("factor", [[1e3, 1e3, 1], [1e8, 1e8, 1e8], [1, 1, 1e9]])
def test_scans_too_large_for_a_grid_are_skipped_before_it_is_made(factor):
    scan = np.concatenate([floor(), wall(2.0)]) * factor
    with pytest.raises(Skipped, match="too large to look for free space in"):
        free_space(scan, scan)


def test_a_free_space_of_a_few_cells_is_nowhere_to_walk():
    free = np.zeros((20, 20), bool)
    free[4:8, 4:9] = True
    place = FreeSpace(np.zeros(2), free, np.full(free.shape, 0.3), 0.0)
    with pytest.raises(Skipped, match="half a metre"):
        place.walk(2.0, 0.06, np.random.default_rng(0))
