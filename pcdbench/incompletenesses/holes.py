"""Holes: round patches are missing, as where a scan was occluded or rushed (the published incompleteness)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pcdbench import options
from pcdbench.errors import CloudError
from pcdbench.incompleteness import Incompleteness
from pcdbench.scene import Scene


class Holes(Incompleteness):
    """Removes the points nearest to random seed points until the level is reached exactly.

    Each seed is drawn from the points still there and takes the nearest of them with it, itself included:
    `share_per_seed` of the complete cloud, the last seed only what the level still asks for. Source: DeepPCD
    (IMWUT 2022), evaluation, 3 % a seed.
    """

    class Options(options.Options):
        share_per_seed: float = Field(0.03, gt=0, le=1, description="share of the complete cloud that one seed removes")

    options: Options

    def kept(self, scene: Scene, level: float, rng: np.random.Generator) -> NDArray[np.bool_]:
        """(N,) mask over `scene.complete` of the points outside all holes; round(level * N) are inside.

        Raises:
            CloudError: where the cloud is so small that nothing would be left.
        """
        points = scene.complete.points
        missing = round(level * len(points))
        if missing >= len(points):
            raise CloudError(
                f"{scene.name}: its {len(points)} points are too few for a level of {level}: none would be left"
            )
        per_seed = max(1, round(self.options.share_per_seed * len(points)))
        columns = np.ascontiguousarray(points.T)
        kept = np.ones(len(points), dtype=bool)
        while missing > 0:
            left = np.flatnonzero(kept)
            hole = _nearest(columns[:, left], int(rng.integers(len(left))), min(per_seed, missing))
            kept[left[hole]] = False
            missing -= len(hole)
        return kept


def _nearest(columns: NDArray[np.float64], seed: int, count: int) -> NDArray[np.int64]:
    """The `count` of the points (3, N) nearest to point `seed`, itself included; of equally near ones the first.

    The seed is subtracted before anything is squared, so that map offsets cost no precision. Ties are
    broken by index and not left to a partial sort, whose order differs between processors.
    """
    x, y, z = columns - columns[:, seed, None]
    distances = x * x + y * y + z * z
    limit = np.partition(distances, count - 1)[count - 1]
    nearer = np.flatnonzero(distances < limit)
    at_limit = np.flatnonzero(distances == limit)
    return np.concatenate([nearer, at_limit[: count - len(nearer)]])
