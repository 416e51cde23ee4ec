"""Patches: every point in its cell, cells that overlap by a hundredth, scales that can be undone, ragged sizes."""

import numpy as np
import pytest
from completer_cases import SIZE_M, box_room
from hypothesis import given, settings
from hypothesis import strategies as st
from pcdbench_completers.patches import OVERLAP, POINTS, Grid, Patches, resampled


def rng():
    return np.random.default_rng(3)


@pytest.mark.parametrize("size", [1, 3, 5])
def test_a_point_is_in_the_cells_whose_widened_borders_hold_it(size):
    points = box_room(3000).points
    grid = Grid.over(points, size)
    scaled = grid.scaled(points)
    members = grid.members(scaled)
    low, high = points.min(axis=0), points.max(axis=0)
    edge = (high - low)[:2] / size
    for (row, column), rows in zip(grid.cells(), members, strict=True):
        near, far = low[:2] + np.add([row, column], [[-OVERLAP], [1 + OVERLAP]]) * edge
        inside = ((points[:, :2] >= near - 1e-9) & (points[:, :2] <= far + 1e-9)).all(axis=1)
        assert np.array_equal(np.flatnonzero(inside), rows)
    assert np.array_equal(np.unique(np.concatenate(members)), np.arange(len(points)))


def test_points_beyond_the_grid_belong_to_the_cells_at_its_border():
    grid = Grid.over(box_room(3000).points, 2)
    members = grid.members(np.array([[-1.0, -1.0, 0.0], [2.0, 2.0, 0.0]]))
    assert [list(rows) for rows in members] == [[0], [], [], [1]]


def test_the_aspect_is_kept_and_the_longest_side_is_one():
    points = box_room(3000).points + np.array([2e6, -1e6, 40.0])
    grid = Grid.over(points, 5)
    scaled = grid.scaled(points)
    assert np.allclose(np.ptp(scaled, axis=0), SIZE_M / 6.0, atol=0.01)
    assert scaled.min() == 0.0 and scaled.max() == 1.0
    assert np.abs(grid.metric(scaled) - points).max() < 1e-8


def test_patches_are_their_points_scaled_by_the_cell_and_not_by_what_is_left_in_it():
    cloud = box_room(12_000)
    whole = Patches.of(cloud.points, 5, rng())
    assert len(whole.points) == 25 and whole.points.shape == (25, POINTS, 3) and whole.points.dtype == np.float32
    assert np.abs(whole.metric(whole.points) - cloud.points[whole.rows].reshape(-1, 3)).max() < 1e-5
    assert whole.points.min() > -1e-6 and whole.points.max() < 1 + 1e-6
    assert np.isclose(whole.points[..., 2].max(), 1.0)  # the room's height is the longest side of a cell
    corner = (cloud.points[:, 0] > 0.6) | (cloud.points[:, 1] > 0.4)
    cut = Patches.of(cloud.points[corner], 5, rng())
    assert cut.scale == pytest.approx(whole.scale, rel=1e-3) and np.allclose(cut.low[0], whole.low[0], atol=1e-3)


def test_cells_with_too_few_points_are_left_out():
    points = box_room(12_000).points
    left_half = points[points[:, 0] < 2.9]
    few = points[points[:, 0] >= 3.1][:40]
    patches = Patches.of(np.concatenate([left_half, few, SIZE_M[None]]), 2, rng())
    assert patches.number.tolist() == [0, 1]
    assert patches.cells.tolist() == [[0, 0], [0, 1]]


def test_the_same_share_of_points_is_enough_in_thinner_clouds():
    points = box_room(4000).points
    assert len(Patches.of(points, 5, rng()).number) == 25


@pytest.mark.parametrize("points", [np.ones((500, 3)), np.array([[0.0, 0, 0], [1, 1, 1]])], ids=["place", "two"])
def test_nothing_to_cut_is_no_patches(points):
    assert Patches.of(points, 5, rng()) is None


@settings(max_examples=50, deadline=None)
@given(have=st.integers(1, 300), want=st.integers(1, 300), seed=st.integers(0, 99))
def test_resampling_uses_all_rows_as_evenly_as_can_be(have, want, seed):
    rows = 1000 + np.arange(have)
    count = np.bincount(resampled(rows, want, np.random.default_rng(seed)) - 1000, minlength=have)
    assert count.sum() == want and count.max() - count.min() <= 1
