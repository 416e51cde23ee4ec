"""Task `chamfer` against brute force, Open3D, hand-computed cases, and by its properties."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pcdbench_tasks.chamfer import Chamfer

from pcdbench import Case, PcdbenchError, PointCloud, Scene, Skipped
from pcdbench.geometry.chamfer import CloudDistances
from pcdbench.open3d_loader import load_open3d
from pcdbench.testing import check_task

seeds = st.integers(0, 2**32)


def case_of(points: np.ndarray, kept: np.ndarray) -> Case:
    cloud = PointCloud(points)
    scene = Scene("scene", cloud, cloud, np.arange(len(cloud)))
    return Case(scene, "holes", float(np.mean(~kept)), 0, kept)


def random_case(seed: int, count: int = 120) -> tuple[Case, np.ndarray]:
    """A random scene, 40 % of it missing at one end, and a random guess at it."""
    rng = np.random.default_rng(seed)
    points = rng.random((count, 3)) * rng.uniform(1, 9, 3)
    kept = points[:, 0].argsort().argsort() >= 0.4 * count
    guess = np.concatenate([points[kept], points[~kept][::2] + rng.normal(0, 0.1, (len(points[~kept][::2]), 3))])
    return case_of(points, kept), guess


def measured(case: Case, completed: np.ndarray, **options: float) -> dict[str, float]:
    task = Chamfer(Chamfer.Options(**options))
    samples = task.evaluate(case, PointCloud(completed), np.random.default_rng(0)).samples
    assert [len(values) for values in samples.values()] == [1] * 5
    return {name: values[0] for name, values in samples.items()}


def by_brute_force(case: Case, completed: np.ndarray, share: float = 0.01) -> dict[str, float]:
    """Every metric from the full distance matrix, as docs/tasks/chamfer.md writes it."""
    complete = case.scene.complete.points
    side = (complete.max(axis=0) - complete.min(axis=0)).max()
    matrix = np.sqrt(((completed[:, None] - complete[None]) ** 2).sum(axis=2))
    forth, back = matrix.min(axis=1), matrix.min(axis=0)
    precision, recall = np.mean(forth < share * side), np.mean(back < share * side)
    added = forth[~case.kept[matrix.argmin(axis=1)]]
    missing = back[~case.kept]
    return {
        "chd": ((forth / side) ** 2).mean() + ((back / side) ** 2).mean(),
        "accuracy_m": forth.mean(),
        "completeness_m": back.mean(),
        "f_score": 2 * precision * recall / (precision + recall) if precision + recall else 0.0,
        "hole_chd": ((missing / side) ** 2).mean() + (((added / side) ** 2).mean() if len(added) else 0.0),
    }


def test_the_contract_holds():
    check_task(Chamfer)
    assert [metric.name for metric in Chamfer.metrics] == ["chd", "accuracy_m", "completeness_m", "f_score", "hole_chd"]


@given(seeds, st.sampled_from([0.01, 0.05, 0.2]))
@settings(max_examples=40, deadline=None)
def test_every_metric_agrees_with_brute_force(seed, share):
    case, guess = random_case(seed)
    assert measured(case, guess, f_score_share=share) == pytest.approx(by_brute_force(case, guess, share), rel=1e-9)


def test_open3d_agrees():
    """Its Chamfer distance is the sum of the mean plain (unsquared) distances, its F-score a percentage."""
    open3d = load_open3d()
    case, guess = random_case(5, count=3000)
    metrics, parameters = open3d.t.geometry.Metric, open3d.t.geometry.MetricParameters()
    parameters.fscore_radius = [0.02 * case.scene.longest_side_m]
    first, second = (
        open3d.t.geometry.PointCloud(points.astype(np.float32)) for points in (guess, case.scene.complete.points)
    )
    chamfer, percent = first.compute_metrics(second, [metrics.ChamferDistance, metrics.FScore], parameters).numpy()
    values = measured(case, guess, f_score_share=0.02)
    assert values["accuracy_m"] + values["completeness_m"] == pytest.approx(chamfer, rel=1e-5)
    assert values["f_score"] == pytest.approx(percent / 100, abs=2e-4)


def test_a_case_computed_by_hand():
    # Four points on a line of 10 m; the last two are missing, and one point is put 1 m beside the third.
    case = case_of(np.array([[0, 0, 0], [2, 0, 0], [6, 0, 0], [10, 0, 0]], float), np.array([True, True, False, False]))
    completed = np.array([[0, 0, 0], [2, 0, 0], [6, 1, 0]], float)
    last = 4**2 + 1  # squared, from the fourth point to the one that was put
    values = measured(case, completed, f_score_share=0.15)
    assert values["chd"] == pytest.approx((1 / 3 + (1 + last) / 4) / 100)
    assert values["accuracy_m"] == pytest.approx(1 / 3)
    assert values["completeness_m"] == pytest.approx((1 + last**0.5) / 4)
    assert values["f_score"] == pytest.approx(2 * 1 * 0.75 / 1.75)
    assert values["hole_chd"] == pytest.approx(((1 + last) / 2 + 1) / 100)


def test_where_nothing_was_put_hole_chd_is_how_far_the_missing_points_are_from_the_rest():
    case = case_of(np.array([[0, 0, 0], [4, 0, 0], [10, 0, 0]], float), np.array([True, True, False]))
    assert measured(case, case.cloud.points)["hole_chd"] == pytest.approx(0.36)


def test_points_put_elsewhere_do_not_count_as_filling_the_hole():
    case = case_of(np.array([[0, 0, 0], [4, 0, 0], [10, 0, 0]], float), np.array([True, True, False]))
    beside_the_first = np.array([[0, 3, 0]], float)
    values = measured(case, np.concatenate([case.cloud.points, beside_the_first]))
    assert values["hole_chd"] == pytest.approx(0.36)
    assert values["accuracy_m"] == pytest.approx(1.0)


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_the_truth_scores_perfectly(seed):
    case, _ = random_case(seed)
    truth = case.scene.complete.points
    shuffled = np.random.default_rng(seed).permutation(truth)
    assert measured(case, shuffled) == {"chd": 0, "accuracy_m": 0, "completeness_m": 0, "f_score": 1, "hole_chd": 0}


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_chamfer_distance_is_symmetric(seed):
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(70, 3)), rng.normal(size=(50, 3))
    there, back = CloudDistances.between(first, second), CloudDistances.between(second, first)
    assert there.chamfer() == pytest.approx(back.chamfer(), rel=1e-12)
    assert there.f_score(0.4) == pytest.approx(back.f_score(0.4))


@given(seeds, st.floats(0.01, 100), st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3))
@settings(max_examples=25, deadline=None)
def test_scale_and_place_do_not_matter_to_normalised_values(seed, scale, shift):
    case, guess = random_case(seed)
    moved_case = case_of(case.scene.complete.points * scale + shift, case.kept)
    before, after = (
        measured(case, guess, f_score_share=0.1),
        measured(moved_case, guess * scale + shift, f_score_share=0.1),
    )
    for name in ("chd", "hole_chd", "f_score"):
        assert after[name] == pytest.approx(before[name], rel=1e-6)
    assert after["accuracy_m"] == pytest.approx(scale * before["accuracy_m"], rel=1e-6)


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_a_turn_of_the_scene_changes_its_unit_and_nothing_else(seed):
    case, guess = random_case(seed)
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    turned_case = case_of(case.scene.complete.points @ turn, case.kept)
    before, after = measured(case, guess), measured(turned_case, guess @ turn)
    side_ratio = case.scene.longest_side_m / turned_case.scene.longest_side_m
    assert after["chd"] == pytest.approx(before["chd"] * side_ratio**2, rel=1e-9)
    assert after["completeness_m"] == pytest.approx(before["completeness_m"], rel=1e-9)


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_the_more_is_missing_the_worse(seed):
    rng = np.random.default_rng(seed)
    points = rng.random((200, 3))
    order = points[:, 0].argsort()
    values = []
    for missing in (20, 60, 100):
        kept = np.ones(200, bool)
        kept[order[:missing]] = False
        values.append(measured(case_of(points, kept), points[kept]))
    for name, sign in (("chd", 1), ("completeness_m", 1), ("f_score", -1)):
        assert (np.diff([sign * value[name] for value in values]) > 0).all()


@given(seeds, st.integers(0, 47))
@settings(max_examples=40, deadline=None)
def test_putting_a_missing_point_back_never_makes_the_hole_worse(seed, which):
    case, guess = random_case(seed)
    better = np.concatenate([guess, case.removed.points[which, None]])
    assert measured(case, better)["hole_chd"] <= measured(case, guess)["hole_chd"] + 1e-15


def test_map_coordinates_keep_their_precision():
    case, guess = random_case(3)
    offset = np.array([2.0**20, -(2.0**21), 2.0**10])
    # On a lattice of 2^-20 m the move is exact, so the values must agree to the last digits.
    points, guess = (np.round(array * 2**20) / 2**20 for array in (case.scene.complete.points, guess))
    near = measured(case_of(points, case.kept), guess)
    far = measured(case_of(points + offset, case.kept), guess + offset)
    assert far == pytest.approx(near, rel=1e-9)


def test_what_cannot_be_measured_is_said():
    case, _ = random_case(0)
    with pytest.raises(PcdbenchError, match="empty"):
        Chamfer().evaluate(case, PointCloud(np.empty((0, 3))), np.random.default_rng(0))
    flat = case_of(np.zeros((10, 3)), np.arange(10) > 4)
    with pytest.raises(Skipped, match="no extent"):
        Chamfer().evaluate(flat, flat.cloud, np.random.default_rng(0))
