"""Short scan: the level is exact, what is kept was seen, and what is missing is natural occlusion."""

import time

import numpy as np
import pytest
from pydantic import ValidationError

from pcdbench.case import make_case
from pcdbench.errors import PcdbenchError
from pcdbench.geometry.poses import pose
from pcdbench.geometry.scanning import scanned
from pcdbench.incompletenesses.short_scan import ShortScan
from pcdbench.scene import Scene


def without_mesh(scene):
    return Scene(scene.name, scene.complete, scene.dense, scene.complete_index)


def kept_of(scene, level, seed=0, **options):
    return make_case(scene, "short_scan", ShortScan(ShortScan.Options(**options)), level, seed).kept


@pytest.mark.parametrize("mesh", [True, False])
@pytest.mark.parametrize("level", [0.02, 0.1, 0.3, 0.5, 0.9])
def test_the_level_is_exact(room, level, mesh):
    scene = room if mesh else without_mesh(room)
    assert (~kept_of(scene, level)).sum() == round(level * len(room.complete))


@pytest.mark.parametrize("fov_deg", [(0.0, 60.0), (77.0, 300.0)])
def test_a_field_of_view_that_cannot_be_is_refused(fov_deg):
    with pytest.raises(ValidationError, match=r"greater than 0|less than or equal to 180"):
        ShortScan.Options(fov_deg=fov_deg)


def test_the_seed_alone_decides(room):
    assert (kept_of(room, 0.3, 4) == kept_of(room, 0.3, 4)).all()
    assert (kept_of(room, 0.3, 4) != kept_of(room, 0.3, 5)).any()


def test_a_longer_walk_sees_what_the_shorter_saw(room):
    few, more = kept_of(room, 0.6, 1), kept_of(room, 0.3, 1)
    assert (more | ~few).all()


def test_one_view_keeps_only_what_is_in_it(room):
    """One view at 95 % missing: all that is kept fits into a cone of the camera's range and angle."""
    kept = room.complete.points[kept_of(room, 0.95, 2)]
    place = scanned(room)
    eye_height = place.sensor_height_m
    directions = []
    for xy in place.free.centers:
        rays = kept - [*xy, eye_height]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        mean = rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0))
        directions.append((rays @ mean).min())
    assert np.degrees(np.arccos(max(directions))) < 50


def test_a_hidden_side_stays_unseen_longest(room):
    """What no free place at eye height sees is in the missing part at a level that leaves room for it."""
    place = scanned(room)
    from pcdbench.geometry.surfels import occluded

    points = room.complete.points
    never = np.ones(len(points), bool)
    for xy in place.free.centers[::15]:
        never &= occluded(place.raycaster, place.at(xy), points, 0.05)
    assert never.sum() > 10
    assert (~kept_of(room, 0.5, 3))[never].mean() > 0.95


def test_the_camera_pans_to_either_side_of_the_walk(room):
    place = scanned(room)
    ahead, panned = (
        ShortScan(ShortScan.Options(pan_deg=pan_deg))._leg(place, np.random.default_rng(0)) for pan_deg in (0, 40)
    )
    yaws = [np.arctan2([view[1, 0] for view in views], [view[0, 0] for view in views]) for views in (ahead, panned)]
    sway_deg = np.degrees((yaws[1] - yaws[0] + np.pi) % (2 * np.pi) - np.pi)
    # A sine in steps of 0.6 rad comes within 0.3 rad of its ends: 40 cos(0.3) = 38.2.
    assert 38.2 <= sway_deg.max() <= 40 + 1e-9 and -40 - 1e-9 <= sway_deg.min() <= -38.2


def test_within_a_view_points_count_from_the_middle_outwards(room):
    place = scanned(room)
    eye, angles_deg = place.center, np.array([20.0, -5.0, 35.0, 0.0, -30.0, 10.0, 60.0])
    around = np.radians(angles_deg)
    points = eye + 0.2 * np.stack([np.cos(around), np.sin(around), np.zeros(7)], axis=1)
    order = ShortScan()._newly_seen(place, points, np.arange(7) == 5, pose(eye))
    # 10 degrees was seen before, and 60 is out of a field of 77.
    assert angles_deg[order].tolist() == [0, -5, 20, -30, 35]


def test_a_cloud_of_which_nothing_would_be_left_is_an_error(room):
    with pytest.raises(PcdbenchError, match="too few"):
        kept_of(room, 0.9999)


def test_the_walk_that_ends_early_is_filled_from_nearby(room):
    kept = kept_of(room, 0.1, 0, most_views=1)
    assert (~kept).sum() == round(0.1 * len(kept))


def test_it_takes_less_than_a_second(room):
    scanned(room)
    seconds = []
    for seed in range(3):
        start = time.process_time()
        kept_of(room, 0.1, seed)
        seconds.append(time.process_time() - start)
    assert min(seconds) < 1.0
