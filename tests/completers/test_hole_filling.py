"""hole_filling: holes are closed along the surface around them, flat or curved."""

import numpy as np
import pytest
from completer_cases import box_room, chamfer, far_from, random_box_room, sphere
from pcdbench_completers.hole_filling import HoleFilling, HoleFillingOptions
from pcdbench_completers.local_surface import unoriented_normals
from pcdbench_completers.triangulation import rim_points
from scipy.spatial import cKDTree

from pcdbench import PointCloud


def completed(cloud, **options):
    return HoleFilling(HoleFillingOptions(**options)).complete(cloud, np.random.default_rng(0))


@pytest.mark.parametrize("hole_m", [0.3, 0.5])
def test_a_hole_in_a_sphere_is_filled_with_points_on_the_sphere(hole_m):
    ball = sphere(1.0, 6000)
    cut = far_from(ball, [[0.6, 0.0, 0.8]], hole_m)
    result = completed(cut)
    new = result.points[len(cut) :]
    # A flat lid lies hole_m**2 / 2 below the sphere at its middle: at most a fifth of that is left, plus the mesh's.
    assert np.abs(np.linalg.norm(new, axis=1) - 1.0).max() < hole_m**2 / 10 + 0.002
    assert len(new) == pytest.approx(len(ball) - len(cut), rel=0.2)
    assert chamfer(result, ball) < 0.05 * chamfer(cut, ball)


def test_a_whole_sphere_is_left_alone():
    ball = sphere(1.0, 6000)
    assert len(completed(ball)) == len(ball)


@pytest.mark.parametrize(
    ("centers", "left"),
    [
        ([[3.0, 2.0, 0.0]], 0.05),
        ([[3.0, 0.0, 1.3], [0.0, 2.0, 1.3]], 0.05),
        ([[3.0, 0.0, 0.0]], 0.07),
        ([[6.0, 4.0, 0.0]], 0.3),
    ],
    ids=["floor", "walls", "edge", "corner"],
)
def test_holes_of_a_box_room_are_closed(centers, left):
    room = box_room()
    cut = far_from(room, centers, 0.8)
    result = completed(cut)
    assert chamfer(result, room) < left * chamfer(cut, room)
    missing = len(room) - len(cut)
    assert 0.5 * missing < len(result) - len(cut) < 1.1 * missing


def test_a_whole_room_is_left_alone():
    room = box_room()
    assert len(completed(room)) == len(room)
    clumps = random_box_room()
    assert len(completed(clumps)) < 1.01 * len(clumps)


def test_surfaces_that_face_each_other_are_not_joined():
    room = box_room()
    rng = np.random.default_rng(1)
    table = rng.uniform([2.0, 1.2, 0.75], [4.0, 2.8, 0.755], (450, 3))
    shelf = rng.uniform([0.0, 3.6, 1.5], [2.0, 4.0, 1.505], (120, 3))
    furnished = PointCloud(np.concatenate([room.points, table, shelf]))
    new = completed(furnished).points[len(furnished) :]
    near_surface, _ = cKDTree(furnished.points).query(new)
    assert len(new) < 0.01 * len(furnished)
    assert (near_surface < 0.2).all()


def test_holes_wider_than_the_longest_edge_stay_open():
    cut = far_from(box_room(), [[3.0, 2.0, 0.0]], 1.2)
    new = completed(cut, max_edge_m=0.8).points[len(cut) :]
    assert not (np.linalg.norm(new - [3.0, 2.0, 0.0], axis=1) < 0.4).any()


def test_the_rim_of_a_hole_is_what_is_near_it():
    ball = sphere(1.0, 6000)
    cut = far_from(ball, [[0.0, 0.0, 1.0]], 0.5)
    rim = rim_points(cut.points, unoriented_normals(cut.points), 0.1, 110.0)
    away = np.linalg.norm(cut.points - [0.0, 0.0, 1.0], axis=1) - 0.5
    assert rim[away < 0.02].mean() > 0.9
    assert not rim[away > 0.1].any()
