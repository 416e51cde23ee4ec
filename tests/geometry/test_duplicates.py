"""Points that are another's to the last bit."""

import numpy as np

from pcdbench.geometry.duplicates import share_held


def test_the_share_of_points_that_a_cloud_holds_leaves_out_what_was_known_and_counts_each_place_once():
    known, taken = np.random.default_rng(0).normal(size=(2, 40, 3))
    wanted = np.concatenate([taken, taken[:20], known[:5]])
    assert share_held(np.concatenate([known, taken[:10]]), wanted, known) == 10 / 40
    assert share_held(np.concatenate([known, np.nextafter(taken, 9)]), wanted, known) == 0
    assert share_held(known, known, known) == 0
