"""The point cloud: immutable, in metres, and refusing what is not a cloud."""

import numpy as np
import pytest

from pcdbench import CloudError, PointCloud

POINTS = np.arange(12.0).reshape(4, 3)


def test_neither_the_arrays_nor_the_fields_can_be_changed(cloud: PointCloud) -> None:
    assert cloud.colors is not None
    for array in (cloud.points, cloud.colors):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(AttributeError):
        cloud.points = POINTS  # type: ignore[misc]


def test_the_callers_arrays_stay_writable_and_apart() -> None:
    points, colors = POINTS.copy(), np.full((4, 3), 0.5, np.float32)
    cloud = PointCloud(points, colors)
    points[0], colors[0] = 99.0, 0.0
    assert cloud.colors is not None
    assert cloud.points[0].tolist() == [0, 1, 2] and cloud.colors[0].tolist() == [0.5] * 3
    view = np.arange(24.0).reshape(4, 6)[:, :3]
    assert not np.shares_memory(PointCloud(view).points, view)


def test_a_cloud_made_of_a_clouds_arrays_copies_nothing(cloud: PointCloud) -> None:
    assert PointCloud(cloud.points, cloud.colors).points is cloud.points


def test_map_coordinates_keep_their_millimetres() -> None:
    far = PointCloud([[1e6 + 0.001, -4e6 - 0.002, 0.003]])
    assert far.points.dtype == np.float64
    assert np.abs(far.points - [1e6, -4e6, 0] - [0.001, -0.002, 0.003]).max() < 1e-8


@pytest.mark.parametrize("points", [np.zeros(3), np.zeros((3, 2)), np.zeros((3, 4)), np.zeros((0,))])
def test_points_of_another_shape_are_refused(points: np.ndarray) -> None:
    with pytest.raises(CloudError, match=r"\(N, 3\)"):
        PointCloud(points)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_points_that_are_not_finite_are_counted_and_refused(bad: float) -> None:
    points = POINTS.copy()
    points[1, 2] = points[1, 0] = points[3, 1] = bad
    with pytest.raises(CloudError, match="2 of 4 points are not finite"):
        PointCloud(points)


@pytest.mark.parametrize("value", [-0.01, 1.01, 255.0])
def test_colors_outside_0_to_1_are_refused(value: float) -> None:
    colors = np.full((4, 3), 0.5)
    colors[2, 1] = value
    with pytest.raises(CloudError, match=r"\[0, 1\]"):
        PointCloud(POINTS, colors)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_colors_that_are_not_finite_are_told_apart_from_8_bit_ones(value: float) -> None:
    colors = np.full((4, 3), 0.5)
    colors[2, 1] = value
    with pytest.raises(CloudError, match=r"the colors of 1 of 4 points are not finite; mend or drop them"):
        PointCloud(POINTS, colors)


def test_colors_must_match_the_points() -> None:
    with pytest.raises(CloudError, match=r"\(4, 3\)"):
        PointCloud(POINTS, np.zeros((3, 3)))


def test_an_empty_cloud_is_a_cloud() -> None:
    empty = PointCloud(np.empty((0, 3)), np.empty((0, 3)))
    assert len(empty) == 0 and repr(empty) == "PointCloud(0 points, colour)"


def test_select_takes_points_and_colors_alike(cloud: PointCloud) -> None:
    assert cloud.colors is not None
    mask = cloud.points[:, 0] > 0.5
    for index in (mask, np.flatnonzero(mask)):
        chosen = cloud.select(index)
        assert chosen.colors is not None
        np.testing.assert_array_equal(chosen.points, cloud.points[mask])
        np.testing.assert_array_equal(chosen.colors, cloud.colors[mask])
    assert cloud.without_colors().select(mask).colors is None


def test_concatenate_keeps_color_only_where_every_part_has_it(cloud: PointCloud) -> None:
    both = PointCloud.concatenate([cloud, cloud])
    assert len(both) == 200 and both.colors is not None
    np.testing.assert_array_equal(both.points[100:], cloud.points)
    assert PointCloud.concatenate([cloud, cloud.without_colors()]).colors is None
    assert len(PointCloud.concatenate([])) == 0


def test_repr_says_size_colour_and_extent() -> None:
    assert repr(PointCloud([[0, 0, 0], [1, 2, 3]])) == "PointCloud(2 points, no colour, 1.00 x 2.00 x 3.00 m)"
