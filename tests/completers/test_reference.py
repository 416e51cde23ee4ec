"""The reference rows: floor, oracle and noise ceiling."""

import numpy as np
import pytest
from completer_cases import box_room
from pcdbench_completers.reference import GroundTruth, Incomplete, Resample

from pcdbench import Case, Scene, Skipped


def case_of(dense_count, complete_count):
    dense = box_room(dense_count)
    index = np.random.default_rng(3).permutation(dense_count)[:complete_count]
    kept = np.arange(complete_count) % 3 > 0
    return Case(Scene("room", dense.select(index), dense, index), "holes", 0.3, 0, kept)


def test_incomplete_and_ground_truth_are_the_cases_own_clouds():
    case, rng = case_of(3000, 1000), np.random.default_rng(0)
    assert np.array_equal(Incomplete().answer(case, rng).points, case.scene.complete.points[case.kept])
    assert GroundTruth().answer(case, rng) is case.scene.complete


def test_resample_is_as_large_evenly_spaced_and_has_no_point_in_common():
    case = case_of(20_000, 1000)
    again = Resample().answer(case, np.random.default_rng(0))
    assert len(again) == 1000 and again.colors is not None
    complete = {tuple(point) for point in case.scene.complete.points}
    dense = {tuple(point) for point in case.scene.dense.points}
    drawn = {tuple(point) for point in again.points}
    assert not drawn & complete and drawn <= dense
    assert np.array_equal(again.points, Resample().answer(case, np.random.default_rng(0)).points)


def test_resample_of_a_thin_scan_is_skipped_with_the_reason():
    with pytest.raises(Skipped, match=r"1,999 points, fewer than twice the complete cloud's 1,000"):
        Resample().answer(case_of(1999, 1000), np.random.default_rng(0))
    assert len(Resample().answer(case_of(2000, 1000), np.random.default_rng(0))) == 1000


def test_references_answer_cases_not_clouds():
    with pytest.raises(NotImplementedError, match="Incomplete is a reference"):
        Incomplete().complete(box_room(10), np.random.default_rng(0))
