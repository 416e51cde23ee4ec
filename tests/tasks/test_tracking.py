"""Tracking: the truth is tracked, a map of nothing is not, walks keep clear of furniture, figures show the rows."""

import time

import numpy as np
import pandas as pd
import pytest
from pcdbench_tasks.tracking import Tracking
from pydantic import ValidationError

from pcdbench.cloud import PointCloud
from pcdbench.geometry.freespace import BODY_RADIUS_M
from pcdbench.geometry.poses import pose
from pcdbench.geometry.scanning import scanned
from pcdbench.geometry.surfels import SurfelCloud
from pcdbench.scene import Scene


def evaluated(case, completed, seed=0, **options):
    return Tracking(Tracking.Options(**options)).evaluate(case, completed, np.random.default_rng(seed))


@pytest.mark.parametrize("options", [{}, {"method": "gicp"}, {"constant_velocity": True}, {"method": "kiss_icp"}])
def test_the_truth_is_tracked(half_room, options):
    found = evaluated(half_room, half_room.scene.complete, **options).samples
    assert np.median(found["tracking_error_m"]) < 0.1
    assert np.median(found["relative_error_m"]) < 0.03


@pytest.mark.parametrize(
    ("options", "unused"),
    [
        ({"method": "kiss_icp", "scales_m": (2.0,), "constant_velocity": True}, "scales_m, constant_velocity"),
        ({"method": "kiss_icp", "gate_m": 0.2, "gate_deg": 9.0}, "gate_m, gate_deg"),
        ({"method": "kiss_icp", "reference_fov_deg": (90.0, 80.0)}, "reference_fov_deg"),
        ({"kiss_icp_voxel_m": 0.1}, "kiss_icp_voxel_m"),
        ({"method": "gicp", "kiss_icp_voxel_m": 0.1}, "kiss_icp_voxel_m"),
    ],
)
def test_options_of_another_method_are_refused(options, unused):
    with pytest.raises(ValidationError, match=f"{unused} would have no effect with method="):
        Tracking.Options(**options)


@pytest.mark.parametrize("method", ["ndt", "gicp", "kiss_icp"])
def test_options_read_back_from_a_row_are_taken(method):
    its = Tracking.Options(method=method)
    assert Tracking.Options.model_validate(its.model_dump(mode="json")) == its


def test_metrics_are_declared_and_the_samples_are_the_steps(half_room):
    found = evaluated(half_room, half_room.cloud, steps=12).samples
    assert list(found) == [metric.name for metric in Tracking.metrics]
    assert [len(values) for values in found.values()] == [12, 12, 12, 1]
    assert found["final_drift_m"][0] == found["tracking_error_m"][-1]


def test_without_a_map_the_first_pose_is_kept(half_room):
    found = evaluated(half_room, half_room.scene.complete.select(np.arange(10)), steps=10)
    true = np.array(found.trace["true"])
    assert found.trace["estimated"] == [found.trace["estimated"][0]] * 11
    expected = np.linalg.norm(true[1:] - true[0], axis=1)
    assert found.samples["tracking_error_m"] == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize("method", ["ndt", "kiss_icp"])
@pytest.mark.parametrize("far_m", [1e7, 1e300])
def test_a_stray_point_far_off_changes_nothing(half_room, method, far_m):
    cloud = half_room.cloud
    strayed = PointCloud(np.vstack([cloud.points, [[far_m, 0, -far_m]]]))
    found, expected = (evaluated(half_room, its, steps=2, walks=1, method=method).trace for its in (strayed, cloud))
    assert found == expected


@pytest.mark.parametrize(
    "options",
    [
        {"fov_deg": (0.0, 60.0)},
        {"fov_deg": (400.0, 60.0)},
        {"reference_fov_deg": (110.0, 200.0)},
        {"reference_fov_deg": (-110.0, 90.0)},
        {"scales_m": (1.0, 0.0)},
    ],
)
def test_fields_of_view_and_scales_that_cannot_be_are_refused(options):
    with pytest.raises(ValidationError, match=r"greater than 0|less than or equal to"):
        Tracking.Options(**options)


def test_steps_and_turns_are_as_small_as_the_options_say(half_room):
    task = Tracking()
    poses = task._true_poses(scanned(half_room.scene), np.random.default_rng(0))
    assert np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).max() <= task.options.step_m + 1e-9
    headings = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    assert np.degrees(np.abs(np.diff(headings))).max() <= task.options.turn_deg + 1e-9
    assert len(poses) == task.options.steps + 1 > 30


def test_walks_never_go_through_furniture_or_walls(room):
    """Against the mesh itself: rays all around each position, between ankle and head, meet nothing within the body."""
    place = scanned(room)
    task = Tracking(Tracking.Options(steps=100))
    angles = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    around = np.stack([np.cos(angles), np.sin(angles), np.zeros(72)], axis=1)
    for seed in range(5):
        positions = task._true_poses(place, np.random.default_rng(seed))[:, :3, 3]
        for height in np.arange(0.15, 1.75, 0.1):
            at_height = positions.copy()
            at_height[:, 2] = place.free.floor_m + height
            hits = place.raycaster.cast(np.repeat(at_height, 72, axis=0), np.tile(around, (len(positions), 1)))
            assert hits.range_m.min() >= BODY_RADIUS_M - 0.01
        legs = np.diff(positions, axis=0)
        moving = np.linalg.norm(legs, axis=1) > 1e-6
        hits = place.raycaster.cast(
            positions[:-1][moving], legs[moving] / np.linalg.norm(legs[moving], axis=1, keepdims=True)
        )
        assert (hits.range_m > np.linalg.norm(legs[moving], axis=1)).all()


def test_every_completer_walks_the_same_path(half_room):
    walks = [evaluated(half_room, cloud, steps=5).trace for cloud in (half_room.cloud, half_room.scene.complete)]
    assert walks[0]["true"] == walks[1]["true"]
    assert walks[0]["estimated"] != walks[1]["estimated"]


def test_same_seed_same_track(half_room):
    first, second = (evaluated(half_room, half_room.cloud, steps=5).samples["tracking_error_m"] for _ in range(2))
    assert first == pytest.approx(second, abs=1e-6)


def test_kiss_icp_is_configured_for_rooms_and_says_so(half_room, monkeypatch):
    monkeypatch.setenv("kiss_icp_mapping", '{"voxel_size": 3.0}')
    trace = evaluated(half_room, half_room.scene.complete, method="kiss_icp", steps=3).trace
    assert trace["kiss_icp"]["data"] == {"max_range": 10.0, "min_range": 0.1, "deskew": False}
    assert trace["kiss_icp"]["mapping"]["voxel_size"] == 0.06


def test_a_scene_without_a_mesh_is_tracked_too(half_room):
    scene = half_room.scene
    bare = Scene(scene.name, scene.complete, scene.dense, scene.complete_index)
    case = type(half_room)(bare, "half", half_room.level, half_room.seed, half_room.kept)
    assert np.mean(evaluated(case, bare.complete, steps=10).samples["tracking_error_m"]) < 0.1


@pytest.mark.parametrize(
    ("found", "believed"),
    [
        (pose([0.29, 0, 0]), True),
        (pose([0, -0.31, 0]), False),
        (pose([0, 0, 0], yaw_rad=np.radians(14)), True),
        (pose([0, 0, 0], yaw_rad=np.radians(-16)), False),
    ],
)
def test_a_registration_far_from_its_guess_is_not_believed(half_room, monkeypatch, found, believed):
    monkeypatch.setattr("pcdbench_tasks.tracking.register", lambda *_: found)
    place, rng = scanned(half_room.scene), np.random.default_rng(0)
    true = np.stack([pose(place.center)] * 2)
    estimated = Tracking()._registered_poses(place, SurfelCloud(half_room.cloud.points), true, rng)
    assert estimated[1] == pytest.approx(true[0] @ found if believed else true[0])


@pytest.mark.parametrize(("constant_velocity", "guessed"), [(False, [0, 0, 0]), (True, [0, 0.05, 0.1])])
def test_each_step_goes_on_from_the_pose_estimated_before(half_room, monkeypatch, constant_velocity, guessed):
    """A device that stands still, of which registration says that it moves by 5 cm, 10 cm and 15 cm."""
    guesses, views = [], []

    def register(live, reference, guess, *_):
        guesses.append(guess[:3, 3])
        return pose([0.05 * len(guesses), 0, 0])

    def shown(cloud, T_scene_sensor, *view):
        views.append((T_scene_sensor[:3, 3], view))
        return cloud.points

    monkeypatch.setattr("pcdbench_tasks.tracking.register", register)
    monkeypatch.setattr("pcdbench_tasks.tracking.shown", shown)
    place = scanned(half_room.scene)
    task = Tracking(Tracking.Options(constant_velocity=constant_velocity))
    true, surfels = np.stack([pose(place.center)] * 4), SurfelCloud(half_room.cloud.points)
    estimated = task._registered_poses(place, surfels, true, np.random.default_rng(0))
    assert (estimated - true)[:, :3, 3] == pytest.approx(np.outer([0, 0.05, 0.15, 0.3], [1, 0, 0]))
    assert np.array(guesses) == pytest.approx(np.outer(guessed, [1, 0, 0]))
    assert np.array([at for at, _ in views]) == pytest.approx(estimated[:3, :3, 3]), "not from where it truly is"
    assert {view for _, view in views} == {(10.0, 110.0, 90.0)}


def test_live_ranges_have_the_noise_of_the_options(half_room, monkeypatch):
    ranges = []

    def register(live, reference, guess, *_):
        ranges.append(np.linalg.norm(live, axis=1))
        return guess

    monkeypatch.setattr("pcdbench_tasks.tracking.register", register)
    for noise_m in (0.0, 0.01):
        evaluated(half_room, half_room.cloud, steps=1, walks=1, noise_m=noise_m)
    assert (ranges[1] - ranges[0]).std() == pytest.approx(0.01, rel=0.1)


def test_of_several_walks_the_one_is_taken_whose_weakest_view_is_firmest(half_room, monkeypatch):
    walks = iter([np.full((4, 4, 4), number) for number in range(3)])
    firmness = {0: [0.9, 0.0], 1: [0.3, 0.3], 2: [0.2, 0.8]}
    place = scanned(half_room.scene)
    monkeypatch.setattr(Tracking, "_walk_poses", lambda *_: next(walks))
    monkeypatch.setattr(place, "firmness", lambda poses, *_: np.array(firmness[int(poses[0, 0, 0])]), raising=False)
    chosen = Tracking(Tracking.Options(walks=3))._true_poses(place, np.random.default_rng(0))
    assert (chosen == 1).all()


def test_figures(half_room):
    task = Tracking(Tracking.Options(steps=4))
    frame = []
    for name, cloud in {"incomplete": half_room.cloud, "ground_truth": half_room.scene.complete}.items():
        found = task.evaluate(half_room, cloud, np.random.default_rng(0))
        frame.append({"scene": "s", "draw": 0, "incompleteness": "holes", "level": 0.5, "missing": 0.5})
        frame[-1] |= {"completer": name} | vars(found)
    figures = task.figures(pd.DataFrame(frame))
    assert set(figures) == {"cdf", "error_by_step", "path"}
    lines = figures["error_by_step"].axes[0].lines
    by_name = {line.get_label(): line.get_ydata() for line in lines}
    assert by_name["incomplete"] == pytest.approx(frame[0]["samples"]["tracking_error_m"])


def drawn(completer, draw, incompleteness, level, start_m, missing=0.3):
    path = [[start_m, 0.0, 0.0], [start_m + 1.0, 0.0, 0.0]]
    case = {"scene": "s", "draw": draw, "incompleteness": incompleteness, "level": level, "missing": missing}
    return case | {
        "completer": completer,
        "samples": {"tracking_error_m": [0.1]},
        "labels": {},
        "trace": {"true": path, "estimated": path},
    }


def test_paths_are_of_one_case_that_all_completers_have():
    cases = [(1, "holes", 0.3, 10.0), (0, "slab", 0.3, 20.0), (0, "holes", 0.1, 30.0), (0, "holes", 0.3, 40.0)]
    rows = [drawn("incomplete", *case) for case in cases]
    rows = [*rows, drawn("mine", *cases[2]), drawn("mine", *cases[1]), drawn("mine", 0, "holes", 0.5, 50.0)]
    figure = Tracking().figures(pd.DataFrame(rows))["path"]
    assert [[line.get_xdata()[0] for line in axis.lines] for axis in figure.axes] == [[20.0, 20.0]] * 2
    assert figure.get_suptitle() == "s, 30% missing (slab), from above"


def test_panels_show_the_largest_errors_of_every_level():
    rows = [drawn("incomplete", 0, "holes", level, 0.0, level) for level in (0.1, 0.5)]
    for row, errors in zip(rows, ([0.1, 0.1, 0.2], [0.4, 0.9, 1.5]), strict=True):
        row["samples"] = {"tracking_error_m": errors}
    figures = Tracking().figures(pd.DataFrame(rows))
    for axis in figures["cdf"].axes:
        assert axis.get_xlim()[0] == 0 and axis.get_xlim()[1] >= 1.5 and axis.get_ylim() == (0, 1.01)
    for axis in figures["error_by_step"].axes:
        assert axis.get_ylim()[0] == 0 and axis.get_ylim()[1] >= 1.5 and axis.get_xlim()[0] == 1


def test_figures_of_real_pairs_say_how_much_was_missing():
    rows = [drawn("incomplete", draw, "real_pair", 0.0, 0.0, missing) for draw, missing in ((0, 0.6), (1, 0.7))]
    figures = Tracking().figures(pd.DataFrame(rows))
    for name in ("cdf", "error_by_step"):
        assert figures[name].axes[0].get_title() == "about 65% missing"
    assert figures["path"].get_suptitle() == "s, about 60% missing (real_pair), from above"


def test_thirty_steps_are_fast(half_room):
    start = time.process_time()
    evaluated(half_room, half_room.cloud)
    assert time.process_time() - start < 8.0
