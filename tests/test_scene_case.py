"""Scenes and cases: boxes with a heading, and points taken away by a mask that is checked."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pcdbench import Box, Case, Incompleteness, PcdbenchError, PointCloud, Scene, make_case


class FirstPointsGo(Incompleteness):
    """Takes the first round(level * N) points, or the last where the rng says so."""

    def kept(self, scene: Scene, level: float, rng: np.random.Generator) -> np.ndarray:
        mask = np.arange(len(scene.complete)) >= round(level * len(scene.complete))
        return mask if rng.random() < 0.5 else mask[::-1]


class Broken(Incompleteness):
    def __init__(self, result: np.ndarray) -> None:
        super().__init__()
        self.result = result

    def kept(self, scene: Scene, level: float, rng: np.random.Generator) -> np.ndarray:
        return self.result


def test_a_turned_box_holds_what_lies_along_its_own_axes() -> None:
    box = Box(np.array([10.0, 20.0, 1.0]), np.array([4.0, 1.0, 2.0]), yaw_rad=math.radians(90))
    # Its long side, 4 m along its own x, lies along the scene's y.
    inside = np.array([[10.0, 21.9, 1.0], [10.4, 18.1, 0.1]])
    outside = np.array([[11.9, 20.0, 1.0], [10.0, 22.1, 1.0], [10.0, 20.0, 2.1]])
    assert box.contains(inside).tolist() == [True, True]
    assert box.contains(outside).tolist() == [False, False, False]
    assert box.contains(outside, margin_m=0.2).tolist() == [False, True, True]


def test_the_heading_turns_counterclockwise_seen_from_above() -> None:
    box = Box(np.zeros(3), np.array([2.0, 0.2, 2.0]), yaw_rad=math.radians(30))
    along = np.array([[math.cos(math.radians(30)), math.sin(math.radians(30)), 0.0]])
    assert box.contains(0.99 * along).all() and not box.contains(0.99 * along * [1, -1, 1]).any()
    np.testing.assert_allclose(box.to_local(along), [[1.0, 0.0, 0.0]], atol=1e-12)


@given(st.floats(-10, 10), st.floats(-1e6, 1e6))
def test_box_coordinates_keep_lengths(yaw_rad: float, offset_m: float) -> None:
    points = np.random.default_rng(0).random((20, 3)) + offset_m
    local = Box(np.full(3, offset_m), np.ones(3), yaw_rad).to_local(points)
    np.testing.assert_allclose(np.linalg.norm(local, axis=1), np.linalg.norm(points - offset_m, axis=1), atol=1e-8)


def test_the_longest_side_is_that_of_the_complete_cloud() -> None:
    complete = PointCloud([[0, 0, 0], [1, -7, 2]])
    dense = PointCloud([[0, 0, 0], [1, -7, 2], [100, 0, 0]])
    assert Scene("s", complete, dense, np.array([0, 1])).longest_side_m == 7.0


def test_what_is_kept_and_what_is_removed_make_up_the_scene(half_room: Case) -> None:
    complete = half_room.scene.complete
    assert len(half_room.cloud) == len(half_room.removed) == len(complete) // 2
    both = np.concatenate([half_room.cloud.points, half_room.removed.points])
    np.testing.assert_array_equal(np.unique(both, axis=0), np.unique(complete.points, axis=0))
    np.testing.assert_array_equal(half_room.cloud.points, complete.points[half_room.kept])


def test_a_case_is_decided_by_its_arguments(room: Scene) -> None:
    taken = [make_case(room, "first", FirstPointsGo(), 0.3, seed).kept for seed in range(20)]
    again = [make_case(room, "first", FirstPointsGo(), 0.3, seed).kept for seed in range(20)]
    np.testing.assert_array_equal(taken, again)
    assert len({mask.tobytes() for mask in taken}) == 2
    case = make_case(room, "first", FirstPointsGo(), 0.3, 7)
    assert (case.incompleteness, case.level, case.seed, case.scene) == ("first", 0.3, 7, room)


@pytest.mark.parametrize("level", [0.0, 1.0, -0.1, 30.0, math.nan])
def test_levels_that_are_no_share_are_refused(room: Scene, level: float) -> None:
    with pytest.raises(PcdbenchError, match="between 0 and 1"):
        make_case(room, "first", FirstPointsGo(), level, 0)


@pytest.mark.parametrize("result", [np.ones(3, bool), np.arange(4000), np.ones((4000, 1), bool)])
def test_an_incompleteness_that_returns_no_mask_is_named(room: Scene, result: np.ndarray) -> None:
    with pytest.raises(PcdbenchError, match="'broken' must return a boolean mask over the 4000"):
        make_case(room, "broken", Broken(result), 0.3, 0)


def test_an_incompleteness_that_takes_more_or_less_than_the_level_is_named(room: Scene) -> None:
    with pytest.raises(
        PcdbenchError, match=r"'broken' must take .*, 1200 of 4000 at level 0.3, not 1199; .*has_levels"
    ):
        make_case(room, "broken", Broken(np.arange(4000) >= 1199), 0.3, 0)
