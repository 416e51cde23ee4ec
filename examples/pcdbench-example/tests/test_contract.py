"""The plugin keeps its contracts, and does what it says on a cloud small enough to check by hand."""

import numpy as np
from pcdbench_example.coverage import Coverage
from pcdbench_example.midpoints import Midpoints

from pcdbench import PointCloud
from pcdbench.testing import check_completer, check_task


def test_contracts() -> None:
    check_completer(Midpoints)
    check_task(Coverage)


def test_a_midpoint_appears_in_the_gap_alone() -> None:
    row = PointCloud([[0, 0, 0], [1, 0, 0], [2, 0, 0], [5, 0, 0], [6, 0, 0]])
    completed = Midpoints(Midpoints.Options(neighbors=2)).complete(row, np.random.default_rng(0))
    assert set(completed.points[5:, 0]) == {3.5, 4.0}
