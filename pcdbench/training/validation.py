"""The figure that training is judged by while it runs: ChD on generated rooms of the split `val`, as a ratio."""

from __future__ import annotations

import numpy as np

from pcdbench.case import Case, make_case
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
        self._floor = [_chd(case, case.cloud.points) for case in self._cases]

    def __call__(self, completer: Completer) -> float:
        ratios = [
            _chd(case, completer.complete(case.cloud, np.random.default_rng(0)).points) / floor
            for case, floor in zip(self._cases, self._floor, strict=True)
        ]
        return float(np.median(ratios))


def _chd(case: Case, points: np.ndarray) -> float:
    """ChD after the density cap that the task `chamfer` has."""
    complete = case.scene.complete.points
    if len(points) > len(complete):
        points = np.random.default_rng(0).permutation(points)[: len(complete)]
    return CloudDistances.between(points, complete).chamfer()
