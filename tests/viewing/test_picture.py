"""Pictures of clouds: what hides what, and where it lies."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.image import imread

from pcdbench.cloud import PointCloud
from pcdbench.viewing.picture import splat, write_picture

RED, BLUE, WHITE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)
EXTENT = (np.zeros(2), np.array([2.0, 1.0]))


def test_the_nearer_point_hides_the_farther_whatever_their_order():
    points = np.array([[1.0, 0.5, 0.0], [1.0, 0.5, 1.0]])
    for order in ([0, 1], [1, 0]):
        image = splat(points[order], np.array([BLUE, RED])[order], EXTENT, 0.1)
        middle = image[image.shape[0] // 2, image.shape[1] // 2]
        assert tuple(middle) == RED
        assert not (image == BLUE).all(axis=2).any()


def test_a_disc_lies_where_its_point_is_with_y_up():
    image = splat(np.array([[0.5, 0.75, 0.0]]), np.array([RED]), EXTENT, 0.1)
    rows, columns = np.nonzero((image == RED).all(axis=2))
    height, width = image.shape[:2]
    assert abs(columns.mean() / width - 0.25) < 0.01 and abs(rows.mean() / height - 0.25) < 0.01
    assert abs(len(rows) / (np.pi * (0.1 * (width - 1) / 2) ** 2) - 1) < 0.1
    assert tuple(image[0, 0]) == WHITE


def test_points_outside_are_left_out():
    image = splat(np.array([[5.0, 5.0, 0.0], [-3.0, 0.5, 0.0]]), np.array([RED, RED]), EXTENT, 0.1)
    assert (image == 1.0).all()


def test_the_ceiling_is_taken_off_and_clouds_without_colour_are_drawn_too(tmp_path, cloud):
    floor = np.random.default_rng(0).random((2000, 3)) * (4, 3, 0.1)
    ceiling = floor + np.array([0, 0, 2.5])
    room = PointCloud(np.concatenate([floor, ceiling]), np.repeat([RED, BLUE], 2000, axis=0))
    write_picture(tmp_path / "a.png", [("true", room), ("half", room.without_colors())], "title", room)
    image = imread(tmp_path / "a.png")[..., :3]
    red = (image[..., 0] > 0.7) & (image[..., 1:] < 0.2).all(axis=2)
    blue = (image[..., 2] > 0.7) & (image[..., :2] < 0.2).all(axis=2)
    assert red.mean() > 0.05 and not blue.any()


def test_what_a_cloud_lacks_is_shown_in_it_alone(tmp_path):
    floor = np.random.default_rng(0).random((2000, 3)) * (4, 4, 0.1)
    room = PointCloud(floor, np.tile(BLUE, (2000, 1)))
    half = floor[:, 0] < 2
    clouds = [("true", room), ("incomplete", room.select(half))]
    write_picture(tmp_path / "a.png", clouds, "title", room, {"incomplete": room.select(~half)})
    image = imread(tmp_path / "a.png")[..., :3]
    orange = (image[..., 0] > 0.75) & (image[..., 2] < 0.6)
    blue = (image[..., 2] > 0.7) & (image[..., :2] < 0.2).all(axis=2)
    left, right = np.split(np.arange(image.shape[1]), [image.shape[1] // 2])
    assert not orange[:, left].any() and orange[:, right].sum() > 0.3 * blue[:, left].sum()
    assert 0.3 < blue[:, right].sum() / blue[:, left].sum() < 0.7


@pytest.mark.parametrize("color", [True, False])
def test_orange_is_spoken_of_where_it_is_shown(tmp_path, monkeypatch, color):
    titles = []
    monkeypatch.setattr(Axes, "set_title", lambda _, text, **how: titles.append(text))
    room = PointCloud(np.random.default_rng(0).random((100, 3)), np.tile(BLUE, (100, 1)) if color else None)
    write_picture(
        tmp_path / "a.png", [("half", room.select(slice(50)))], "title", room, {"half": room.select(slice(50, 100))}
    )
    assert titles == ["half\n50 points, 50 missing" + (" (orange)" if color else "")]


def test_many_clouds_are_wrapped(tmp_path):
    floor = PointCloud(np.random.default_rng(0).random((500, 3)))
    sizes = {}
    for count in (5, 6):
        write_picture(tmp_path / "a.png", [(str(number), floor) for number in range(count)], "title", floor)
        sizes[count] = imread(tmp_path / "a.png").shape
    assert sizes[6][1] < 0.7 * sizes[5][1] and sizes[6][0] > 1.7 * sizes[5][0]
