"""plane_fitting: the gaps of walls and floors are filled, and nothing else."""

import numpy as np
import pytest
from completer_cases import SIZE_M, box_room, chamfer, far_from, random_box_room
from pcdbench_completers.plane_fitting import PlaneFitting
from pcdbench_completers.plane_raster import PlaneRaster
from pcdbench_completers.planes import Plane, planes

from pcdbench import PointCloud


def completed(cloud):
    return PlaneFitting().complete(cloud, np.random.default_rng(0))


def test_six_faces_of_a_room_are_six_planes():
    cloud = box_room()
    points = cloud.points - SIZE_M / 2
    face = np.abs(np.abs(points) / (SIZE_M / 2) - 1).argmin(axis=1)
    normals = np.eye(3)[face]
    found = planes(points, normals, 0.03, 100, 40, np.random.default_rng(0))
    assert len(found) == 6
    for plane in found:
        axis = int(np.abs(plane.normal).argmax())
        assert abs(plane.normal[axis]) > 0.99999
        assert abs(abs(plane.offset) - SIZE_M[axis] / 2) < 0.002
    rows = np.concatenate([plane.inliers for plane in found])
    assert len(np.unique(rows)) == len(rows) > 0.98 * len(points)


@pytest.mark.parametrize(
    "centers",
    [[[3.0, 2.0, 0.0]], [[3.0, 0.0, 1.3]], [[6.0, 4.0, 0.0]], [[1.5, 0.0, 0.0], [4.5, 2.0, 2.7], [0.0, 2.0, 1.3]]],
    ids=["floor", "wall", "corner", "several"],
)
def test_holes_of_a_box_room_are_filled_up_to_the_walls_and_not_beyond(centers):
    room = box_room()
    cut = far_from(room, centers, 0.9)
    result = completed(cut)
    assert chamfer(result, room) < 0.15 * chamfer(cut, room)
    new = result.points[len(cut) :]
    assert (new > -0.15).all() and (new < SIZE_M + 0.15).all()
    assert len(new) == pytest.approx(len(room) - len(cut), rel=0.35)


@pytest.mark.parametrize(("lowest_m", "ends"), [(0.0, True), (0.8, True), (1.6, False)])
def test_a_plane_ends_at_another_one_that_has_points_nearby(lowest_m, ends):
    """A floor up to x = 2 m, and a wall at x = 3 m, of which nothing lower was seen: the floor goes on up to it."""
    x, y = np.meshgrid(np.arange(0.05, 2, 0.1), np.arange(0.05, 4, 0.1))
    floor = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    wall = np.stack([np.full(x.size, 3.0), y.ravel(), x.ravel() + lowest_m], axis=1)
    points = np.concatenate([floor, wall])
    normals, offsets = np.array([[0.0, 0, 1], [1.0, 0, 0]]), (0.0, 3.0)
    rasters = [
        PlaneRaster.around(Plane(normal, offset, rows), points, 0.1, 2.0, np.array([1.0, 0, 0]))
        for normal, offset, rows in zip(normals, offsets, np.split(np.arange(len(points)), 2), strict=True)
    ]
    limits = {"reach_m": 1.5, "support_m": 1.0, "min_enclosed": 0.75, "min_own": 0.3, "one_side": 0.97}
    filled = rasters[0].places(rasters[0].gaps(rasters[1:], points, **limits))
    between = (np.abs(filled[:, :2] - [2.5, 2.0]) < [0.25, 0.95]).all(axis=1)
    assert between.sum() == (5 * 19 if ends else 0) and filled[:, 0].max(initial=0) < 3.1


def test_the_clumps_of_random_sampling_are_no_gaps():
    cloud = random_box_room()
    assert len(completed(cloud)) < 1.02 * len(cloud)


def test_new_points_take_the_color_of_their_own_plane():
    cut = far_from(box_room(), [[3.0, 0.0, 0.0]], 0.8)
    result = completed(cut)
    new, colors = result.points[len(cut) :], result.colors[len(cut) :]
    on_floor = (new[:, 2] < 0.02) & (new[:, 1] > 0.2)
    on_wall = (new[:, 1] < 0.02) & (new[:, 2] > 0.2)
    assert on_floor.sum() > 50 and on_wall.sum() > 50
    assert np.abs(colors[on_floor] - [0.1, 0.8, 0.1]).max() < 0.02
    assert np.abs(colors[on_wall] - [0.8, 0.1, 0.1]).max() < 0.02


def test_a_wall_behind_a_cupboard_is_left_open():
    room = box_room()
    x, z = room.points[:, 0], room.points[:, 2]
    hidden = (room.points[:, 1] < 0.05) & (x > 2) & (x < 4) & (z < 1.8)
    rng = np.random.default_rng(1)
    front = np.column_stack([rng.uniform(2, 4, 900), np.full(900, 0.3), rng.uniform(0, 1.8, 900)])
    scan = PointCloud(np.concatenate([room.points[~hidden], front]))
    result = completed(scan)
    new = result.points[len(scan) :]
    behind = (np.abs(new[:, 1]) < 0.1) & (new[:, 0] > 2.4) & (new[:, 0] < 3.6) & (new[:, 2] > 0.4) & (new[:, 2] < 1.4)
    assert behind.sum() == 0


def test_two_tables_side_by_side_are_not_joined():
    rng = np.random.default_rng(2)
    tables = rng.uniform([0, 0, 0], [1.2, 1.2, 0.004], (2000, 3))
    tables[1000:, 0] += 2.0
    new = completed(PointCloud(tables)).points[2000:]
    assert not ((new[:, 0] > 1.4) & (new[:, 0] < 1.8)).any()
