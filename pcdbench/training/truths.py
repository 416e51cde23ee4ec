"""The truths that training pairs come from: dense clouds of generated crops, and what a walk misses of them."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError, Skipped
from pcdbench.files import read_arrays, write_arrays
from pcdbench.geometry.neighbors import nearest
from pcdbench.geometry.sampling import own_numbers
from pcdbench.keys import seed_from
from pcdbench.paths import cache_dir
from pcdbench.scene import Scene

TRUTH_POINTS = 160_000  # seven or more a sub-voxel at the densities trained on; more only cost time
WALK_LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5)


@dataclass(frozen=True, eq=False)
class Truth:
    """A dense cloud and, for each of its points, how little a walk must see to miss it.

    Attributes:
        cloud: (N,) points, metres.
        missed: (N,) at how many of `WALK_LEVELS` a short scan leaves the point unseen: 5 is missed first.
    """

    cloud: PointCloud
    missed: NDArray[np.uint8]

    def select(self, rows: NDArray) -> Truth:
        """The truth of these rows (or of this mask)."""
        return Truth(self.cloud.select(rows), self.missed[rows])


class Truths:
    """Training truths by number; the latest few stay in memory."""

    def __init__(self, kept: int) -> None:
        self._kept = kept
        self._held: OrderedDict[int, Truth] = OrderedDict()

    def __getitem__(self, index: int) -> Truth:
        if index not in self._held:
            self._held[index] = training_truth(index)
        self._held.move_to_end(index)
        while len(self._held) > self._kept:
            self._held.popitem(last=False)
        return self._held[index]


def training_truth(index: int) -> Truth:
    """The dense cloud of the first crop of training environment `index`, from the cache where it is there.

    Other crops of an environment show the same materials and furniture, so each environment is used once.
    """
    from pcdbench.datasets.synthetic import Indoor
    from pcdbench.datasets.synthetic.indoor import CROPS

    path = cache_dir() / "training" / Indoor.version / f"{index:06d}.npz"
    arrays = read_arrays(path)
    if arrays is None:
        scene = Indoor().training_scene(CROPS * index)
        rows = np.sort(np.argsort(own_numbers(scene.dense.points), kind="stable")[:TRUTH_POINTS])
        dense = scene.dense.select(rows)
        assert dense.colors is not None
        arrays = {
            "points": dense.points.astype(np.float32),
            "colors": np.rint(dense.colors * 255).astype(np.uint8),
            "missed": _missed_by_walks(scene, seed_from("training walk", index))[
                nearest(dense.points, scene.complete.points)[1]
            ],
        }
        write_arrays(path, arrays)
    cloud = PointCloud(arrays["points"], arrays["colors"].astype(np.float32) / np.float32(255))
    return Truth(cloud, arrays["missed"])


def _missed_by_walks(scene: Scene, seed: int) -> NDArray[np.uint8]:
    """(N,) for the complete cloud: at how many of `WALK_LEVELS` one and the same walk leaves a point unseen."""
    from pcdbench.incompletenesses.short_scan import ShortScan

    missed = np.zeros(len(scene.complete), dtype=np.uint8)
    try:
        for level in WALK_LEVELS:
            missed += ~ShortScan().kept(scene, level, np.random.default_rng(seed))
    except (CloudError, Skipped):
        return np.zeros(len(scene.complete), dtype=np.uint8)
    return missed
