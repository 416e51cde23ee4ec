"""The reference rows: the floor (incomplete), the oracle (ground truth) and the noise ceiling (resample)."""

from __future__ import annotations

import numpy as np

from pcdbench import Case, PointCloud, ReferenceCompleter, Skipped
from pcdbench.geometry.sampling import poisson_disk_indices


class Incomplete(ReferenceCompleter):
    """The incomplete cloud itself: what doing nothing is worth."""

    def answer(self, case: Case, rng: np.random.Generator) -> PointCloud:
        """What is left of the complete cloud."""
        return case.cloud


class GroundTruth(ReferenceCompleter):
    """The complete cloud itself: what no completer can do better than."""

    def answer(self, case: Case, rng: np.random.Generator) -> PointCloud:
        """The complete cloud."""
        return case.scene.complete


class Resample(ReferenceCompleter):
    """Another, independent sample of the dense cloud: the best that a method can honestly reach.

    A metric's value here is its noise: the same surface, sampled as densely, with no point in common.
    """

    def answer(self, case: Case, rng: np.random.Generator) -> PointCloud:
        """A Poisson-disk sample, as many points as the complete cloud, of the dense points not in it.

        Raises:
            Skipped: where the dense cloud has fewer than twice as many points as the complete one.
        """
        dense, count = case.scene.dense, len(case.scene.complete)
        if len(dense) < 2 * count:
            raise Skipped(
                f"the dense cloud of {case.scene.name} has {len(dense):,} points, fewer than twice the complete "
                f"cloud's {count:,}: no independent second sample of that density exists"
            )
        unused = np.ones(len(dense), dtype=bool)
        unused[case.scene.complete_index] = False
        others = dense.select(unused)
        return others.select(poisson_disk_indices(others.points, count, rng))
