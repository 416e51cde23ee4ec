"""Task `ssim`: one at the truth, near one at the noise ceiling, lower the more is missing."""

from pathlib import Path

import numpy as np
import pytest
from pcdbench_tasks.ssim import Ssim

from pcdbench import Case, PointCloud, Scene, Skipped
from pcdbench.datasets.synthetic import Indoor
from pcdbench.geometry.sampling import poisson_disk_indices
from pcdbench.testing import check_task, small_room

POINTS = 20_000


def two_samples(dense: PointCloud, seed: int = 0) -> tuple[Scene, PointCloud]:
    """A scene of 20,000 points, and another sample of its dense cloud that shares none of them."""
    rng = np.random.default_rng(seed)
    index = poisson_disk_indices(dense.points, POINTS, rng)
    rest = np.setdiff1d(np.arange(len(dense)), index)
    other = rest[poisson_disk_indices(dense.points[rest], POINTS, rng)]
    assert len(np.intersect1d(index, other)) == 0
    return Scene("scene", dense.select(index), dense, index), dense.select(other)


@pytest.fixture(scope="module")
def generated() -> tuple[Scene, PointCloud]:
    return two_samples(small_room(POINTS).dense)


def case_of(scene: Scene, missing: float = 0.3) -> Case:
    """The scene without the share of its points nearest to one of them."""
    points = scene.complete.points
    order = np.linalg.norm(points - points[17], axis=1).argsort(kind="stable")
    kept = np.ones(len(points), bool)
    kept[order[: round(missing * len(points))]] = False
    return Case(scene, "holes", missing, 0, kept)


def ssim(case: Case, completed: PointCloud, **options: float) -> float:
    samples = Ssim(Ssim.Options(**options)).evaluate(case, completed, np.random.default_rng(0)).samples
    (value,) = samples["ssim"]
    return value


def test_the_contract_holds():
    check_task(Ssim)


def test_the_truth_scores_one_in_any_order(generated):
    scene, _ = generated
    order = np.random.default_rng(0).permutation(POINTS)
    assert ssim(case_of(scene), scene.complete.select(order)) == pytest.approx(1.0, abs=1e-6)


def test_the_noise_ceiling_of_a_generated_room_is_high(generated):
    scene, other = generated
    assert ssim(case_of(scene), other) >= 0.95


def test_the_noise_ceiling_of_a_real_kitchen_is_high(real_data: Path):
    path = real_data / "redkitchen" / "clouds" / "full.ply"
    if not path.is_file():
        pytest.skip(f"no {path}")
    scene, other = two_samples(PointCloud.read(path))
    assert ssim(case_of(scene), other) >= 0.95


def test_the_more_is_missing_the_lower(generated):
    scene, other = generated
    values = [ssim(case, case.cloud) for case in (case_of(scene, missing) for missing in (0.1, 0.3, 0.5, 0.8))]
    assert (np.diff(values) < 0).all()
    assert values[0] < ssim(case_of(scene), other)


def test_wrong_colours_cost(generated):
    scene, _ = generated
    truth = scene.complete
    values = [
        ssim(case_of(scene), PointCloud(truth.points, np.clip(truth.colors * factor, 0, 1)))
        for factor in (1.0, 0.8, 0.4)
    ]
    assert (np.diff(values) < -0.01).all()


def test_what_was_put_outside_hides_the_room_behind_it(generated):
    scene, _ = generated
    truth = scene.complete
    low, size = truth.points.min(axis=0), np.ptp(truth.points, axis=0)
    flat = low + np.random.default_rng(0).random((4000, 3)) * size * np.array([1, 1, 0])
    values = [
        ssim(
            case_of(scene),
            PointCloud.concatenate([truth, PointCloud(flat + np.array([0, 0, height]), np.ones((4000, 3)))]),
        )
        for height in (size[2] + 1, size[2] + 20)
    ]
    assert values[0] == pytest.approx(values[1])
    assert values[0] < 0.9


def test_a_cloud_of_nothing_has_a_low_value(generated):
    scene, _ = generated
    assert ssim(case_of(scene), scene.complete.select(np.arange(0))) < 0.5


def test_the_place_does_not_matter(generated):
    scene, other = generated
    offset = np.array([2.0**20, -(2.0**21), 2.0**9])

    def moved(cloud: PointCloud) -> PointCloud:
        return PointCloud(np.round(cloud.points * 2**20) / 2**20 + offset, cloud.colors)

    complete = moved(scene.complete)
    far = Scene("far", complete, complete, np.arange(POINTS))
    assert ssim(case_of(far), moved(other)) == pytest.approx(ssim(case_of(scene), other), abs=2e-3)


def test_the_resolution_is_an_option(generated):
    scene, other = generated
    case = case_of(scene)
    assert ssim(case, other, voxel_spacings=2.0) < ssim(case, other, voxel_spacings=5.0)


def test_what_cannot_be_measured_is_skipped(generated):
    scene, _ = generated
    with pytest.raises(Skipped, match="colour"):
        ssim(case_of(scene), scene.complete.without_colors())
    one_place = PointCloud(np.ones((50, 3)), np.ones((50, 3)))
    with pytest.raises(Skipped, match="distinct"):
        ssim(case_of(Scene("place", one_place, one_place, np.arange(50))), one_place)


def test_a_scene_too_thin_to_see_is_skipped_unless_single_points_count():
    two = PointCloud(np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([[1.0, 0, 0], [0, 1, 0]]))
    scene = Scene("two", two, two, np.arange(2))
    case = Case(scene, "holes", 0.5, 0, np.array([True, False]))
    with pytest.raises(Skipped, match="too thin"):
        ssim(case, two, voxel_points=3)
    assert ssim(case, two, voxel_points=1) == pytest.approx(1.0)
    assert np.isfinite(ssim(case, case.cloud, voxel_points=1))


def test_stray_points_before_a_wall_do_not_hide_it(generated):
    scene, _ = generated
    truth = scene.complete
    rng = np.random.default_rng(0)
    low, size = truth.points.min(axis=0), np.ptp(truth.points, axis=0)
    stray = PointCloud(low + rng.random((15, 3)) * size + np.array([0, 0, size[2]]), rng.random((15, 3)))
    with_stray = PointCloud.concatenate([truth, stray])
    assert ssim(case_of(scene), with_stray) > 0.98
    assert ssim(case_of(scene), with_stray, voxel_points=1) < 0.95


def test_the_noise_ceiling_of_a_generated_environment_is_high():
    scene = (indoor := Indoor()).scene(indoor.scene_names("smoke")[0])
    rest = np.setdiff1d(np.arange(len(scene.dense)), scene.complete_index)
    other = rest[poisson_disk_indices(scene.dense.points[rest], len(scene.complete), np.random.default_rng(0))]
    case = case_of(scene, 0.5)
    ceiling = ssim(case, scene.dense.select(other))
    assert ceiling >= 0.95
    assert ceiling > ssim(case, case.cloud) + 0.05
