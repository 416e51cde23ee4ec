"""Localization: the truth is found, half of it is not, draws are paired, and too little keeps the guess."""

import time
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from pcdbench_tasks.localization import Localization, _places_in_sight
from pydantic import ValidationError

from pcdbench.case import Case
from pcdbench.cloud import PointCloud
from pcdbench.geometry.poses import pose
from pcdbench.geometry.scanning import scanned
from pcdbench.geometry.visibility import MeshRaycaster


def evaluated(case, completed, seed=0, **options):
    return Localization(Localization.Options(**options)).evaluate(case, completed, np.random.default_rng(seed))


def rows(case, task):
    frame = []
    for level in (0.3, 0.5):
        for name, cloud in {"incomplete": case.cloud, "ground_truth": case.scene.complete, "other": case.cloud}.items():
            found = task.evaluate(case, cloud, np.random.default_rng(0))
            frame.append({"scene": "s", "draw": 0, "incompleteness": "holes", "level": level, "missing": level})
            frame[-1] |= {"completer": name} | vars(found)
    return pd.DataFrame(frame)


@pytest.mark.parametrize("method", ["ndt", "icp", "gicp"])
def test_every_method_finds_most_locations_in_the_truth(half_room, method):
    found = evaluated(half_room, half_room.scene.complete, method=method).samples
    assert np.median(found["localization_error_m"]) < 0.02
    assert np.mean(found["success"]) >= 0.8
    assert np.median(found["rotation_error_deg"]) < 0.5


def test_one_wall_is_not_enough(half_room):
    """A map of one wall fixes the distance to it and nothing along it."""
    points = half_room.scene.complete.points
    wall = PointCloud(points[points[:, 0] < 0.05])
    truth = evaluated(half_room, half_room.scene.complete).samples["localization_error_m"]
    assert np.mean(evaluated(half_room, wall).samples["localization_error_m"]) > 3 * np.mean(truth)


def test_metrics_are_declared_and_consistent(half_room):
    found = evaluated(half_room, half_room.cloud, locations=6).samples
    assert list(found) == [metric.name for metric in Localization.metrics]
    error, planar = np.array(found["localization_error_m"]), np.array(found["localization_error_planar_m"])
    assert len(error) == 6
    assert (planar <= error + 1e-12).all()
    assert (np.array(found["success"]) == (error <= 0.1)).all()


def test_errors_are_distances_in_the_trace(half_room):
    found = evaluated(half_room, half_room.cloud)
    distances = np.linalg.norm(np.subtract(found.trace["true"], found.trace["estimated"]), axis=1)
    assert found.samples["localization_error_m"] == pytest.approx(distances, abs=2e-4)


def test_every_completer_meets_the_same_locations(half_room):
    traces = [evaluated(half_room, cloud).trace for cloud in (half_room.cloud, half_room.scene.complete)]
    assert traces[0]["true"] == traces[1]["true"]
    assert evaluated(half_room, half_room.cloud, seed=1).trace["true"] != traces[0]["true"]


def test_same_seed_same_error(half_room):
    first, second = (evaluated(half_room, half_room.cloud).samples["localization_error_m"] for _ in range(2))
    assert first == pytest.approx(second, abs=1e-6)


@pytest.mark.parametrize("count", [0, 3, 15])
def test_a_map_of_hardly_a_point_keeps_the_guess(half_room, count):
    cloud = half_room.scene.complete.select(np.arange(count))
    found = evaluated(half_room, cloud)
    expected = np.linalg.norm(np.subtract(found.trace["true"], found.trace["reference"]), axis=1)
    assert found.samples["localization_error_m"] == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize("far_m", [1e7, 1e300])
def test_a_stray_point_far_off_changes_nothing(half_room, far_m):
    cloud = half_room.cloud
    strayed = PointCloud(np.vstack([cloud.points, [[far_m, 0, -far_m]]]))
    found, expected = (evaluated(half_room, its, locations=2).trace for its in (strayed, cloud))
    assert found == expected


@pytest.mark.parametrize("scale_m", [0.0, -0.5])
def test_scales_that_are_no_lengths_are_refused(scale_m):
    with pytest.raises(ValidationError, match="greater than 0"):
        Localization.Options(scales_m=(1.0, scale_m))


def test_a_location_outside_of_the_scene_is_not_believed(half_room, monkeypatch):
    answers = iter([pose([0.2, 0, 0]), pose([50, 0, 0]), pose([0, 0, -3]), pose([0, 0.1, 0.1], yaw_rad=0.5)])
    monkeypatch.setattr("pcdbench_tasks.localization.register", lambda *_: next(answers))
    found = evaluated(half_room, half_room.cloud, locations=4, yaw_deg=0)
    moved = np.subtract(found.trace["estimated"], found.trace["reference"])
    assert moved == pytest.approx(np.array([[0.2, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0.1, 0.1]]), abs=2e-4)
    off = np.subtract(found.trace["estimated"], found.trace["true"])
    assert found.samples["localization_error_m"] == pytest.approx(np.linalg.norm(off, axis=1), abs=2e-4)
    assert found.samples["localization_error_planar_m"] == pytest.approx(np.hypot(off[:, 0], off[:, 1]), abs=2e-4)
    assert found.samples["rotation_error_deg"] == pytest.approx([0, 0, 0, np.degrees(0.5)], abs=1e-9)


def test_a_place_behind_a_board_is_not_in_sight_and_one_far_off_not_near():
    board = np.array([[1.5, -0.5, 0], [1.5, 0.5, 0], [1.5, 0.5, 2], [1.5, -0.5, 2]])
    place = SimpleNamespace(
        center=np.array([0, 0, 1.4]),
        free=SimpleNamespace(centers=np.array([[1.0, 0], [2.0, 0.2], [-1.0, 2.0], [-3.0, 0]])),
        at=lambda xy: np.column_stack([xy, np.full(len(xy), 1.4)]),
        raycaster=MeshRaycaster(board, [[0, 1, 2], [0, 2, 3]]),
    )
    assert _places_in_sight(place, 2.5).tolist() == [[1.0, 0, 1.4], [-1.0, 2.0, 1.4]]


def test_the_map_is_what_shows_from_the_reference_and_live_ranges_are_noisy(half_room, monkeypatch):
    place = scanned(half_room.scene)
    y, z = np.meshgrid(np.arange(-20, 20) * 0.05, np.arange(-20, 20) * 0.05)
    board = np.stack([np.ones(y.size), y.ravel(), z.ravel()], axis=1)
    lives, maps = [], []

    def register(live, reference, guess, *_):
        lives.append(live)
        maps.append(reference)
        return guess

    monkeypatch.setattr("pcdbench_tasks.localization.register", register)
    completed = PointCloud(np.concatenate([board, board * [1.6, 0.8, 0.8]]) + place.center)
    for noise_m in (0.0, 0.01):
        evaluated(half_room, completed, locations=5, noise_m=noise_m)
    assert all(shown == pytest.approx(board, abs=1e-6) for shown in maps), "the second board is hidden"
    exact, noisy = (np.linalg.norm(np.concatenate(scans), axis=1) for scans in (lives[:5], lives[5:]))
    assert (noisy - exact).std() == pytest.approx(0.01, rel=0.05)


def test_live_headings_differ_by_at_most_the_option(half_room):
    task = Localization(Localization.Options(locations=30, yaw_deg=8.0))
    poses, _ = task._live_scans(scanned(half_room.scene), np.random.default_rng(0))
    yaw_deg = np.degrees(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    assert 6 < yaw_deg.max() <= 8 and -8 <= yaw_deg.min() < -6


def test_locations_are_free_near_and_in_sight(half_room):
    place = scanned(half_room.scene)
    true = np.array(evaluated(half_room, half_room.cloud, locations=40).trace["true"])
    assert np.linalg.norm(true - place.center, axis=1).max() <= Localization.Options().radius_m + 1e-3
    assert place.free.clearance_at(true[:, :2]).min() >= 0.25


def test_a_scene_on_a_map_far_away_is_measured_the_same(half_room):
    scene = half_room.scene
    shift = np.array([4e5, 5e6, 100.0])

    def moved(cloud):
        return PointCloud(cloud.points + shift, cloud.colors)

    from pcdbench.scene import Scene, Surface

    surface = Surface(scene.surface.vertices + shift, scene.surface.triangles, scene.surface.transparent)
    far = Scene(scene.name, moved(scene.complete), moved(scene.dense), scene.complete_index, surface=surface)
    case = Case(far, half_room.incompleteness, half_room.level, half_room.seed, half_room.kept)
    found = evaluated(case, far.complete, radius_m=0.5).samples["localization_error_m"]
    assert np.median(found) < 0.02


def test_figures(half_room):
    task = Localization(Localization.Options(locations=3))
    figures = task.figures(rows(half_room, task))
    assert set(figures) == {"cdf", "from_above"}
    axis = figures["cdf"].axes[0]
    assert {line.get_label() for line in axis.lines} == {"incomplete", "ground_truth", "other"}
    assert all(line.get_ydata()[-1] == 1.0 for line in axis.lines)
    assert len(figures["cdf"].axes) == 2


def test_every_lowest_panel_has_numbers_below(half_room):
    task = Localization(Localization.Options(locations=1))
    two = rows(half_room, task)
    five = pd.concat([two[two.level == 0.5], *(two[:1].assign(completer=name, level=0.5) for name in "ab")])
    figure = task.figures(five)["from_above"]
    figure.draw_without_rendering()
    numbered = [
        any(label.get_visible() for label in axis.get_xticklabels()) for axis in figure.axes if axis.get_visible()
    ]
    assert numbered == [False, False, True, True, True]


def test_ten_locations_are_fast(half_room):
    evaluated(half_room, half_room.cloud)
    seconds = []
    for seed in range(3):
        start = time.process_time()
        evaluated(half_room, half_room.cloud, seed)
        seconds.append(time.process_time() - start)
    assert min(seconds) < 3.0
