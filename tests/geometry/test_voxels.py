"""Voxels against brute force and by their properties."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pcdbench.geometry.neighbors import median_spacing
from pcdbench.geometry.voxels import MAX_VOXELS_A_SIDE, VoxelGrid, edge_from_density, voxelize

corners = hnp.arrays(np.float64, 3, elements=st.floats(-100, 100))
sizes = hnp.arrays(np.float64, 3, elements=st.floats(0, 20))
edges = st.floats(0.05, 5)


@given(corners, sizes, edges)
def test_a_grid_covers_its_box_centred_and_with_no_voxel_to_spare(low, size, edge):
    grid = VoxelGrid.covering(low, low + size, edge)
    end = grid.origin + edge * np.array(grid.shape)
    before, after = low - grid.origin, end - (low + size)
    np.testing.assert_allclose(before, after, atol=1e-9)
    assert (before >= -1e-9).all()
    assert (before <= edge / 2 + 1e-9).all()


def test_points_outside_belong_to_the_nearest_border_voxel():
    grid = VoxelGrid(np.zeros(3), 0.5, (4, 3, 2))
    points = np.array([[0.1, 0.6, 0.9], [-5.0, 0.6, 0.9], [0.1, 99.0, 0.9], [1e12, -1e12, 1e12]])
    assert grid.clamped_index(points).tolist() == [[0, 1, 1], [0, 1, 1], [0, 2, 1], [3, 0, 1]]


@given(st.integers(0, 2**32), st.integers(0, 200), st.integers(1, 4))
def test_voxels_hold_the_mean_colour_of_their_points(seed, count, min_points):
    rng = np.random.default_rng(seed)
    points, colors = rng.normal(0, 1, (count, 3)), rng.random((count, 3)).astype(np.float32)
    grid = VoxelGrid.covering(np.full(3, -1.0), np.full(3, 1.0), 0.7)
    voxels = voxelize(points, colors, grid, min_points)
    expected: dict[tuple[int, ...], list] = {}
    for point, color in zip(points, colors, strict=True):
        key = tuple(min(max(int((point[i] - grid.origin[i]) // 0.7), 0), grid.shape[i] - 1) for i in range(3))
        expected.setdefault(key, []).append(color)
    expected = {key: members for key, members in expected.items() if len(members) >= min_points}
    assert sorted(expected) == sorted(map(tuple, voxels.index.tolist()))
    for index, color in zip(voxels.index, voxels.colors, strict=True):
        np.testing.assert_allclose(color, np.mean(expected[tuple(index)], axis=0), atol=1e-6)


def test_map_coordinates_give_the_same_voxels():
    rng = np.random.default_rng(0)
    points, colors = rng.random((2000, 3)) * 8, rng.random((2000, 3))
    offset = np.array([1e6, -2e6, 4e5])
    near, far = (
        voxelize(cloud, colors, VoxelGrid.covering(cloud.min(axis=0), cloud.max(axis=0), 0.3))
        for cloud in (points, points + offset)
    )
    assert near.shape == far.shape
    np.testing.assert_array_equal(near.index, far.index)
    np.testing.assert_allclose(near.colors, far.colors)


def test_the_edge_follows_the_density():
    points = np.stack(np.meshgrid(np.arange(30), np.arange(30), [0, 10]), axis=-1).reshape(-1, 3) * 0.1
    assert edge_from_density(points, 4.0) == pytest.approx(0.4)
    assert edge_from_density(points * 3, 4.0) == pytest.approx(1.2)


def test_a_point_that_is_there_twice_is_no_neighbour_of_its_own():
    row = np.arange(5.0)[:, None] * [2.0, 0, 0]
    assert median_spacing(np.concatenate([row, row, row[:3]])) == 2.0
    assert median_spacing(np.repeat(row, 4, axis=0)) == median_spacing(np.repeat(row, 13, axis=0)) == 2.0
    # Most points are there many times; the few that are not lie closer together.
    few = row[:3] / 10 - 7
    assert median_spacing(np.concatenate([np.repeat(row, 9, axis=0), few])) == 2.0


def test_the_edge_of_a_cloud_of_tight_pairs_is_bounded():
    rng = np.random.default_rng(0)
    points = rng.random((500, 3)) * 10
    points = np.concatenate([points, points + 1e-7])
    assert median_spacing(points) < 1e-6
    edge = edge_from_density(points, 4.0)
    assert max(VoxelGrid.covering(points.min(axis=0), points.max(axis=0), edge).shape) <= MAX_VOXELS_A_SIDE + 1


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.ones((1, 3)), np.ones((50, 3))])
def test_a_cloud_without_extent_has_no_edge(points):
    assert edge_from_density(points, 4.0) == 0.0
