"""The figure that training is judged by while it runs: ChD on generated rooms of the split `val`, as a ratio."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcdbench.case import make_case
from pcdbench.completer import Completer
from pcdbench.geometry.chamfer import CloudDistances
from pcdbench.incompletenesses.holes import Holes

LEVEL = 0.3


class Validation:
    """Median ratio of a completer's ChD to that of doing nothing, over fixed cases; below 1 it helps."""

    def __init__(self, scenes: int = 6) -> None:
        from pcdbench.datasets.synthetic import Indoor

        dataset = Indoor()
        names = dataset.scene_names("val")[:scenes]
        self._cases = [make_case(dataset.scene(name), "holes", Holes(), LEVEL, seed=1) for name in names]
        self._floor = [capped_chd(case.cloud.points, case.scene.complete.points) for case in self._cases]

    def __call__(self, completer: Completer) -> float:
        ratios = [
            capped_chd(completer.complete(case.cloud, np.random.default_rng(0)).points, case.scene.complete.points)
            / floor
            for case, floor in zip(self._cases, self._floor, strict=True)
        ]
        return float(np.median(ratios))


def capped_chd(points: NDArray[np.float64], complete: NDArray[np.float64]) -> float:
    """ChD of (N, 3) completed and (M, 3) complete points, after the density cap that the task `chamfer` has."""
    if len(points) > len(complete):
        points = np.random.default_rng(0).permutation(points)[: len(complete)]
    return CloudDistances.between(points, complete).chamfer()
