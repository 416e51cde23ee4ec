"""What is shown of clouds: added points, thinning, far echoes, ceilings; and what packing them costs."""

import base64
import time

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from pcdbench import PointCloud, Scene
from pcdbench.viewing.payload import payload
from pcdbench.viewing.shown import ceiling_cut_m, missing_in, shown_clouds


def test_points_of_a_completion_that_are_no_observed_ones_are_added(room: Scene) -> None:
    rng = np.random.default_rng(0)
    cloud = room.complete
    kept = rng.random(len(cloud)) < 0.7
    order = rng.permutation(len(cloud))
    added = missing_in(cloud.select(order), cloud.select(kept))
    assert np.array_equal(added, ~kept[order])
    # Written and read again: single precision moves points a little, and they are the same points still.
    moved = PointCloud(cloud.points.astype(np.float32))
    assert np.array_equal(missing_in(moved, cloud.select(kept)), ~kept)


def test_a_cloud_that_lacks_most_of_the_other_is_no_completion_of_it(room: Scene) -> None:
    cloud = room.complete
    few = np.arange(len(cloud)) < 0.4 * len(cloud)
    assert missing_in(cloud.select(few), cloud) is None
    assert missing_in(PointCloud(cloud.points + 0.01), cloud) is None


def test_marks_come_before_comparing_and_follow_their_points_through_thinning(room: Scene) -> None:
    cloud = room.complete
    marks = cloud.points[:, 0] > 1.0
    first, second, third = shown_clouds(
        [("a", cloud), ("b", cloud), ("c", cloud)], [None, marks, None], reference=None, at_most=1000
    )
    assert (first.added, first.added_total) == (None, 0)
    assert np.array_equal(second.added, second.cloud.points[:, 0] > 1.0)
    assert (second.added_total, second.compared_with) == (marks.sum(), None)
    assert (third.added_total, third.compared_with) == (0, "a")
    assert len(first.cloud) == len(second.cloud) == 1000 and first.total == len(cloud)


def test_confidence_follows_its_points_and_is_packed(room: Scene) -> None:
    cloud = room.complete
    trust = np.clip(cloud.points[:, 0] / 5, 0, 1)
    first, second = shown_clouds([("a", cloud), ("b", cloud)], [None, None], None, 1000, {"b": trust})
    assert first.confidence is None
    np.testing.assert_allclose(second.confidence, np.clip(second.cloud.points[:, 0] / 5, 0, 1))
    packed = payload([first, second])
    assert packed["modes"] == ["color", "added", "confidence", "height"]
    assert packed["clouds"][0]["confidence"] is None
    numbers = np.frombuffer(base64.b64decode(packed["clouds"][1]["confidence"]), np.uint8)
    np.testing.assert_allclose(numbers / 255, second.confidence, atol=0.5 / 255)


def test_thinning_is_even_and_always_the_same() -> None:
    cloud = PointCloud(np.column_stack([np.arange(50_000) / 1000, np.zeros(50_000), np.zeros(50_000)]))
    (its,) = shown_clouds([("a", cloud)], [None], None, 5000)
    (again,) = shown_clouds([("a", cloud)], [None], None, 5000)
    assert np.array_equal(its.cloud.points, again.cloud.points)
    assert len(np.unique(its.cloud.points[:, 0])) == 5000
    counts, _ = np.histogram(its.cloud.points[:500, 0], 5, (0, 50))
    assert counts.min() > 60, "the first ones are spread over the whole"


def test_far_echoes_are_left_out_and_counted() -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.random((5000, 3)) * [5, 4, 3] + [1e6, 2e6, 0], [[0, 0, 0], [1e6, 2e6, 9e3]]])
    (its,) = shown_clouds([("a", PointCloud(points))], [None], None, 10_000)
    assert (its.far, its.total, len(its.cloud)) == (2, 5002, 5000)


def test_distances_are_to_the_nearest_point_of_the_reference() -> None:
    rng = np.random.default_rng(1)
    cloud, reference = PointCloud(rng.random((300, 3))), PointCloud(rng.random((200, 3)))
    (its,) = shown_clouds([("a", cloud)], [None], reference, 1000)
    assert its.distance_m == pytest.approx(cdist(its.cloud.points, reference.points).min(axis=1))


def box(low: tuple[float, ...], high: tuple[float, ...], count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(low, high, (count, 3))


def test_the_ceiling_is_found_though_it_is_thin_and_a_cupboard_is_none() -> None:
    floor, walls = box((0, 0, 0), (5, 4, 0), 9000), box((0, 0, 0), (5, 0.1, 2.6), 5000)
    cupboard = box((0, 0, 2.1), (1, 1, 2.1), 5000)
    assert ceiling_cut_m(np.concatenate([floor, walls, cupboard])) is None
    ceiling = box((0, 0, 2.58), (5, 4, 2.62), 1000)
    cut = ceiling_cut_m(np.concatenate([floor, walls, cupboard, ceiling]))
    assert cut is not None and 2.3 < cut < 2.58


@pytest.mark.parametrize("offset", [(4e9, 4e9, 0.0), (0.0, 0.0, 2e4)])
def test_clouds_farther_apart_than_any_building_have_no_ceiling(offset: tuple[float, ...]) -> None:
    room = np.concatenate([box((0, 0, 0), (5, 0.1, 2.6), 500), box((0, 0, 2.58), (5, 4, 2.62), 1000)])
    began = time.perf_counter()
    assert ceiling_cut_m(np.concatenate([room, room + offset])) is None
    assert time.perf_counter() - began < 0.5


def test_a_few_strays_however_far_off_do_not_hide_the_ceiling() -> None:
    room = np.concatenate([box((0, 0, 0), (5, 0.1, 2.6), 9000), box((0, 0, 2.58), (5, 4, 2.62), 9000)])
    strays = np.full((5, 3), (5e8, 5.8e9, 3.0))
    assert ceiling_cut_m(np.concatenate([room, strays])) == pytest.approx(ceiling_cut_m(room), abs=0.01)


def test_generated_rooms_have_a_ceiling_and_tables_have_none(room: Scene) -> None:
    points = room.complete.points
    assert ceiling_cut_m(points[points[:, 2] < 1.0]) is None


def test_unpacked_values_are_what_was_packed() -> None:
    rng = np.random.default_rng(2)
    offset = np.array([4e5, 5e6, 100])
    cloud = PointCloud(rng.random((1000, 3)) * [8, 5, 3] + offset, rng.integers(256, size=(1000, 3)) / 255)
    reference = PointCloud(np.add(cloud.points[:10], [0, 0, 0.3]))
    marks = rng.random(1000) < 0.3
    shown = shown_clouds([("a", cloud)], [marks], reference, 2000)
    packed = payload(shown)
    (its,) = packed["clouds"]
    (one,) = shown

    def unpack(name: str, kind: str) -> np.ndarray:
        return np.frombuffer(base64.b64decode(its[name]), kind)

    steps = unpack("xyz", "<u2").reshape(-1, 3)
    back = steps / 65535 * packed["span_m"] + one.cloud.points.min(axis=0)
    assert np.abs(back - one.cloud.points).max() < 8 / 65535
    assert np.array_equal(unpack("rgb", "u1").reshape(-1, 3), np.rint(one.cloud.colors * 255))
    assert np.array_equal(np.unpackbits(unpack("added", "u1"), bitorder="little")[:1000].astype(bool), one.added)
    most = packed["distance_max_m"]
    assert most in (0.1, 0.2, 0.5, 1, 2, 5, 10) and (one.distance_m > most).mean() <= 0.05
    clipped = np.minimum(one.distance_m, most)
    assert np.abs(unpack("distance", "u1") / 255 * most - clipped).max() <= most / 255
    assert packed["modes"] == ["color", "added", "height", "distance"]


@pytest.mark.parametrize("points", [[[1.0, 2.0, 3.0]], [[0, 0, 0], [0, 0, 0]], [[0, 0, 0], [0, 1, 0], [0, 2, 0]]])
def test_degenerate_clouds_are_packed(points: list[list[float]]) -> None:
    packed = payload(shown_clouds([("a", PointCloud(points))], [None], None, 10))
    assert packed["span_m"] > 0 and packed["spacing_m"] > 0 and packed["mode"] == "height"
