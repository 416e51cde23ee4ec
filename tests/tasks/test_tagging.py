"""Task `tagging`: objects that are there are found, those that are gone are not."""

import numpy as np
import pandas as pd
import pytest
from pcdbench_tasks.tagging import Tagging

from pcdbench import Box, Case, Measurements, PointCloud, Scene, Skipped, TaggedObject
from pcdbench.geometry.sampling import poisson_disk_indices
from pcdbench.geometry.voxels import MAX_VOXELS_A_SIDE
from pcdbench.testing import check_task, half_missing, small_room

COLORS = ((0.9, 0.2, 0.2), (0.2, 0.8, 0.3), (0.3, 0.4, 0.9), (0.9, 0.8, 0.3))
LABELS = ("chair", "table", "chair", "shelf")


def furniture(yaw_rad: float = 0.0, count: int = 3000, seed: int = 0) -> Scene:
    """Four coloured boxes in a row, `count` points on the sides of each, turned together about the origin."""
    rng = np.random.default_rng(seed)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    R_scene_row = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    points, colors, objects = [], [], []
    for place, (color, label) in enumerate(zip(COLORS, LABELS, strict=True)):
        center, size = np.array([3.0 * place, 1.0, 0.6]), np.array([0.8, 0.5 + 0.2 * place, 1.2])
        local = rng.random((count, 3)) - 0.5
        side = rng.integers(0, 3, count)
        local[np.arange(count), side] = np.where(rng.random(count) < 0.5, -0.5, 0.5)
        points.append((center + local * size) @ R_scene_row.T)
        colors.append(np.tile(color, (count, 1)) * (0.7 + 0.1 * side[:, None]))
        objects.append(TaggedObject(label, Box(R_scene_row @ center, size, yaw_rad)))
    cloud = PointCloud(np.concatenate(points), np.concatenate(colors))
    return Scene("row", cloud, cloud, np.arange(len(cloud)), tuple(objects))


def without(scene: Scene, *places: int) -> Case:
    kept = np.ones(len(scene.complete), bool)
    for place in places:
        kept &= ~scene.objects[place].box.contains(scene.complete.points, 0.02)
    return Case(scene, "holes", float(np.mean(~kept)), 0, kept)


def evaluate(case: Case, completed: PointCloud, **options: float) -> Measurements:
    return Tagging(Tagging.Options(**options)).evaluate(case, completed, np.random.default_rng(0))


def test_the_contract_holds():
    check_task(Tagging)


@pytest.mark.parametrize("yaw_rad", [0.0, 0.4, -2.0])
def test_exactly_the_missing_objects_fail(yaw_rad):
    scene = furniture(yaw_rad)
    case = without(scene, 1, 3)
    found = evaluate(case, case.cloud)
    assert found.samples["failure_rate"] == [0.0, 1.0, 0.0, 1.0]
    assert found.labels == {name: list(LABELS) for name in ("failure_rate", "object_ssim")}
    similarity = found.samples["object_ssim"]
    assert similarity[0] == similarity[2] == pytest.approx(1.0)
    assert max(similarity[1], similarity[3]) < 0.5


def test_the_truth_finds_everything():
    scene = furniture()
    found = evaluate(without(scene, 0), scene.complete)
    assert found.samples["failure_rate"] == [0.0] * 4
    assert found.samples["object_ssim"] == pytest.approx([1.0] * 4)


def test_images_are_taken_in_the_frame_of_the_box():
    """Turning scene and boxes together changes nothing: the same points fall into the same voxels."""
    values = [
        evaluate(case, case.cloud).samples["object_ssim"]
        for case in (half_missing(furniture(yaw_rad), seed=4) for yaw_rad in (0.0, 0.7))
    ]
    assert values[1] == pytest.approx(values[0], abs=0.02)
    assert min(values[0]) < 0.9


def test_a_recoloured_object_fails():
    scene = furniture()
    colors = scene.complete.colors.copy()
    inside = scene.objects[2].box.contains(scene.complete.points, 0.02)
    colors[inside] = 1 - colors[inside]
    found = evaluate(without(scene, 0), PointCloud(scene.complete.points, colors))
    assert found.samples["failure_rate"] == [0.0, 0.0, 1.0, 0.0]


def test_the_threshold_is_an_option():
    case = half_missing(furniture(), seed=1)
    similarity = np.array(evaluate(case, case.cloud).samples["object_ssim"])
    for threshold in (0.3, 0.6, 0.95):
        failures = evaluate(case, case.cloud, found_above=threshold).samples["failure_rate"]
        assert failures == (similarity <= threshold).astype(float).tolist()


def test_another_sample_finds_the_objects_of_a_room_and_half_of_it_does_not():
    dense = small_room(20_000).dense
    rng = np.random.default_rng(0)
    index = poisson_disk_indices(dense.points, 20_000, rng)
    rest = np.setdiff1d(np.arange(len(dense)), index)
    other = dense.select(rest[poisson_disk_indices(dense.points[rest], 20_000, rng)])
    scene = Scene("room", dense.select(index), dense, index, small_room().objects)
    case = half_missing(scene, seed=0)
    assert sum(evaluate(case, other).samples["failure_rate"]) == 0
    assert sum(evaluate(case, case.cloud).samples["failure_rate"]) >= 1


def test_objects_that_even_the_truth_hides_are_left_out():
    scene = furniture()
    hidden = TaggedObject("ghost", Box(np.array([0.0, 50.0, 0.0]), np.ones(3)))
    with_ghost = Scene("row", scene.complete, scene.dense, scene.complete_index, (hidden, *scene.objects))
    found = evaluate(without(with_ghost, 2), with_ghost.complete)
    assert found.labels["failure_rate"] == list(LABELS)
    only_ghost = Scene("row", scene.complete, scene.dense, scene.complete_index, (hidden,))
    with pytest.raises(Skipped, match="points in the complete cloud"):
        evaluate(Case(only_ghost, "holes", 0.3, 0, without(scene, 1).kept), scene.complete)


def test_a_box_far_larger_than_its_scene_takes_no_more_pixels_than_a_scene(monkeypatch):
    shapes = []

    def similarity(answer, truth):
        shapes.extend([answer.shape, truth.shape])
        return 1.0

    monkeypatch.setattr("pcdbench_tasks.tagging.six_face_similarity", similarity)
    scene = furniture()
    house = TaggedObject("house", Box(np.zeros(3), np.array([1e5, 40.0, 3.0])))
    tagged = Scene("row", scene.complete, scene.dense, scene.complete_index, (house,))
    evaluate(Case(tagged, "holes", 0.3, 0, without(scene, 1).kept), scene.complete)
    assert len(shapes) == 2 and max(map(max, shapes)) <= MAX_VOXELS_A_SIDE + 1


def test_what_cannot_be_measured_is_skipped():
    scene = furniture()
    case = without(scene, 0)
    with pytest.raises(Skipped, match="colour"):
        evaluate(case, scene.complete.without_colors())
    untagged = Scene("row", scene.complete, scene.dense, scene.complete_index)
    with pytest.raises(Skipped, match="no tagged objects"):
        evaluate(Case(untagged, "holes", 0.3, 0, case.kept), scene.complete)
    heap = PointCloud(np.ones((50, 3)), np.full((50, 3), 0.5))
    at_one_place = Scene("heap", heap, heap, np.arange(50), (TaggedObject("chair", Box(np.ones(3), np.ones(3))),))
    with pytest.raises(Skipped, match="no two distinct points"):
        evaluate(Case(at_one_place, "holes", 0.5, 0, np.arange(50) < 25), heap)


def test_an_empty_completed_cloud_finds_nothing():
    scene = furniture()
    assert evaluate(without(scene, 0), scene.complete.select(np.arange(0))).samples["failure_rate"] == [1.0] * 4


def test_figures_show_the_failure_rate_by_label():
    scene = furniture()
    rows = []
    for level, places in ((0.1, (1,)), (0.3, (0, 1))):
        case = without(scene, *places)
        for completer, cloud in (("incomplete", case.cloud), ("ground_truth", scene.complete)):
            found = evaluate(case, cloud)
            rows.append({"scene": "row", "level": level, "missing": level, "completer": completer} | vars(found))
    figures = Tagging().figures(pd.DataFrame(rows))
    assert list(figures) == ["failure_rate_by_label_10_percent", "failure_rate_by_label_30_percent"]
    axes = figures["failure_rate_by_label_30_percent"].axes[0]
    labels = [text.get_text() for text in axes.get_yticklabels()]
    widths = {
        container.get_label(): dict(zip(labels, [bar.get_width() for bar in container], strict=True))
        for container in axes.containers
    }
    assert widths["incomplete"] == {"chair": 0.5, "table": 1.0, "shelf": 0.0}
    assert set(widths["ground_truth"].values()) == {0.0}


def test_labels_are_no_formulas():
    label = r"price $\frac{$ tag"
    row = {"scene": "row", "completer": "c", "labels": {"failure_rate": [label]}, "samples": {"failure_rate": [1.0]}}
    (figure,) = Tagging().figures(pd.DataFrame([row | {"level": 0.3, "missing": 0.3}])).values()
    figure.draw_without_rendering()
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == [label]


def test_each_level_has_a_figure_of_its_own_and_real_pairs_say_how_much_was_missing():
    its = {"scene": "row", "completer": "c", "labels": {"failure_rate": ["chair"]}, "samples": {"failure_rate": [1.0]}}
    rows = [
        its | {"level": level, "missing": missing} for level, missing in ((0.0, 0.62), (0.12, 0.12), (0.125, 0.125))
    ]
    figures = Tagging().figures(pd.DataFrame(rows))
    assert list(figures) == [f"failure_rate_by_label_{percent}_percent" for percent in ("0", "12", "12.5")]
    titles = [figure.axes[0].get_title() for figure in figures.values()]
    assert titles == [f"tagging by label, {missing} missing" for missing in ("about 62%", "12%", "12.5%")]
