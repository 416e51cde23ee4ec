"""Simulated scans: where rays meet surfels, what hides what, and that no scan returns the cloud's own points."""

import numpy as np
import pytest

from pcdbench.cloud import PointCloud
from pcdbench.geometry.neighbors import nearest
from pcdbench.geometry.poses import pose, transform
from pcdbench.geometry.scanning import ScannedScene, cast_scan, random_directions, scanned, shown, within_view
from pcdbench.geometry.surfels import SurfelCloud, occluded, surfel_mesh
from pcdbench.scene import Scene


def without_mesh(scene):
    return Scene(scene.name, scene.complete, scene.dense, scene.complete_index)


def plane(x, half, spacing=0.05):
    y, z = np.meshgrid(np.arange(-half, half, spacing), np.arange(-half, half, spacing))
    return np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1)


def test_surfels_of_a_plane_lie_in_it_and_close_it():
    points = plane(2.0, 1.0)
    vertices, triangles = surfel_mesh(points)
    assert vertices[:, 0] == pytest.approx(2.0)
    assert triangles.shape == (4 * len(points), 3)
    directions = random_directions(2000, 40, 40, np.random.default_rng(0))
    hits = SurfelCloud(points).raycaster.cast(np.zeros(3), directions)
    assert (directions * hits.range_m[:, None])[:, 0] == pytest.approx(2.0, abs=1e-4)


def test_a_stray_point_has_a_disk_of_at_most_three_times_the_others():
    points = np.concatenate([plane(2.0, 1.0), [[2.0, 5.0, 0.0]]])
    corners = surfel_mesh(points)[0].reshape(-1, 6, 3) - points[:, None]
    radius = np.linalg.norm(corners, axis=2)
    # The third nearest on a grid of 5 cm is as near as the first.
    assert np.median(radius) == pytest.approx(0.05) and radius[-1] == pytest.approx(3 * 0.05)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_a_handful_of_points_hide_nothing(count):
    points = plane(2.0, 1.0)[:count]
    assert len(shown(SurfelCloud(points), np.eye(4), 10.0)) == count


@pytest.mark.parametrize("times", [2, 4, 12])
def test_copies_of_points_change_no_disk(times):
    points = np.concatenate([plane(1.0, 0.5), plane(3.0, 3.0)])
    vertices, triangles = surfel_mesh(np.repeat(points, times, axis=0))
    expected_vertices, expected_triangles = surfel_mesh(points)
    assert np.array_equal(vertices, expected_vertices) and np.array_equal(triangles, expected_triangles)
    assert len(shown(SurfelCloud(np.repeat(points, times, axis=0)), np.eye(4), 10.0)) == times * len(
        shown(SurfelCloud(points), np.eye(4), 10.0)
    )


def test_a_board_hides_the_wall_behind_it_and_nothing_else():
    board, wall = plane(1.0, 0.5), plane(3.0, 3.0)
    cloud = SurfelCloud(np.concatenate([board, wall]))
    seen = shown(cloud, np.eye(4), 10.0)
    on_wall = seen[seen[:, 0] > 2]
    behind = np.abs(wall[:, 1:]).max(axis=1) < 1.4
    beside = np.abs(wall[:, 1:]).max(axis=1) > 1.7
    assert np.abs(on_wall[:, 1:]).max(axis=1).min() > 1.39
    assert (seen[:, 0] < 2).sum() == len(board)
    assert behind.sum() > 1000
    assert (np.abs(on_wall[:, 1:]).max(axis=1) > 1.7).sum() > 0.999 * beside.sum()


def test_a_pose_is_held_by_three_walls_and_by_nothing_less():
    directions = random_directions(4000, 120.0, 120.0, np.random.default_rng(0))
    wall = plane(2.0, 9.0, spacing=0.2)
    side, floor = wall[:, [1, 0, 2]], wall[:, [1, 2, 0]] * [1, 1, -1]

    def firmness(*planes, lower=-20.0):
        place = object.__new__(ScannedScene)  # planes alone: there is nowhere to stand
        place.raycaster, place.lower, place.upper = SurfelCloud(np.concatenate(planes)).raycaster, lower, 20.0
        return place.firmness(np.eye(4)[None], directions, 10.0)[0]

    assert firmness(wall) == pytest.approx(0.0, abs=1e-3)
    assert firmness(wall, side) == pytest.approx(0.0, abs=1e-3)
    assert firmness(wall, side, floor) > 0.05
    assert firmness(wall, side, floor, lower=-1.0) == pytest.approx(0.0, abs=1e-3), "the floor is out of bounds"


def test_the_sensor_is_held_lower_where_the_scene_ends_below_a_persons_height():
    x, y = np.meshgrid(np.arange(0, 2.01, 0.05), np.arange(0, 2.01, 0.05))
    floor = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    for height_m, sensor_m in ((0.95, 0.78), (2.45, 1.4)):
        cloud = PointCloud(np.concatenate([floor, [[0.0, 0.0, height_m]]]))
        # The margin of the bounds is 5 cm.
        place = ScannedScene(Scene("low", cloud, cloud, np.arange(len(cloud))))
        assert place.center[2] == place.sensor_height_m == pytest.approx(sensor_m)


def test_what_surfels_hide_is_what_the_mesh_hides(room):
    place = scanned(room)
    points = room.dense.points
    by_mesh = ~occluded(place.raycaster, place.center, points, 0.05)
    seen = np.isin(np.arange(len(points)), SurfelCloud(points).visible(place.center, np.arange(len(points))))
    assert (seen == by_mesh).mean() > 0.97


def test_a_scan_without_a_mesh_is_the_scan_of_the_mesh(room):
    with_mesh, without = ScannedScene(room), ScannedScene(without_mesh(room))
    T_scene_sensor = pose(with_mesh.center, 0.3)
    directions = random_directions(3000, 360, 120, np.random.default_rng(0))
    truth = with_mesh.raycaster.cast(with_mesh.center, directions @ T_scene_sensor[:3, :3].T).range_m
    found = without.raycaster.cast(with_mesh.center, directions @ T_scene_sensor[:3, :3].T).range_m
    assert np.median(np.abs(found - truth)) < 0.005
    assert (np.abs(found - truth) < 0.05).mean() > 0.9


def test_live_scans_never_hold_points_of_the_clouds(room):
    for scene in (room, without_mesh(room)):
        place = ScannedScene(scene)
        T_scene_sensor = pose(place.center)
        rng = np.random.default_rng(0)
        live = place.scan(T_scene_sensor, random_directions(3000, 360, 120, rng), 10.0, 0.0, rng)
        distances, _ = nearest(transform(T_scene_sensor, live), scene.dense.points)
        assert len(live) > 2500
        assert distances.min() > 1e-5
        assert np.median(distances) < 0.05


def test_noise_is_along_the_ray_and_of_the_given_size():
    wall = SurfelCloud(plane(3.0, 4.0)).raycaster
    rng = np.random.default_rng(0)
    directions = random_directions(20_000, 60, 40, rng)
    exact = cast_scan(wall, np.eye(4), directions, 10.0, 0.0, rng)
    noisy = cast_scan(wall, np.eye(4), directions, 10.0, 0.02, rng)
    assert np.cross(exact, noisy) == pytest.approx(0, abs=1e-6)
    assert np.linalg.norm(noisy - exact, axis=1).std() == pytest.approx(0.02 * np.sqrt(1 - 2 / np.pi), rel=0.05)


def test_nothing_outside_the_crop_is_measured(room):
    left = room.dense.points[:, 0] < 2.5
    dense = PointCloud(room.dense.points[left])
    crop = Scene("crop", dense, dense, np.arange(len(dense)), surface=room.surface)
    place = ScannedScene(crop)
    rng = np.random.default_rng(0)
    T_scene_sensor = pose(place.center)
    live = transform(T_scene_sensor, place.scan(T_scene_sensor, random_directions(4000, 360, 120, rng), 10, 0.01, rng))
    assert live[:, 0].max() <= 2.56
    assert len(live) > 1000


def test_the_field_of_view_is_one_of_angles_in_the_sensors_frame():
    points = np.random.default_rng(0).normal(0, 3, (5000, 3)) + np.array([5, -2, 1])
    T_scene_sensor = pose([5, -2, 1], yaw_rad=2.0, pitch_rad=0.3)
    inside = np.zeros(len(points), bool)
    inside[within_view(points, T_scene_sensor, 4.0, 77.0, 60.0)] = True
    local = (points - T_scene_sensor[:3, 3]) @ T_scene_sensor[:3, :3]
    azimuth = np.degrees(np.arctan2(local[:, 1], local[:, 0]))
    elevation = np.degrees(np.arctan2(local[:, 2], np.hypot(local[:, 0], local[:, 1])))
    expected = (np.abs(azimuth) < 38.5) & (np.abs(elevation) < 30) & (np.linalg.norm(local, axis=1) < 4)
    assert (inside == expected).all()
    assert 50 < inside.sum() < 2000


def test_random_directions_fill_the_field_and_no_more():
    directions = random_directions(20_000, 110, 90, np.random.default_rng(0))
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1)
    assert len(within_view(directions, np.eye(4), 2.0, 110.001, 90.001)) == 20_000
    assert np.degrees(np.arcsin(directions[:, 2])).max() > 44.5
