"""Real pair: nothing is taken away; the incomplete cloud is a shorter scan of the same place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pcdbench import options
from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError, Skipped
from pcdbench.geometry.neighbors import median_spacing, nearest
from pcdbench.geometry.sampling import poisson_disk_indices
from pcdbench.incompleteness import Incompleteness
from pcdbench.scene import Scene


class RealPair(Incompleteness):
    """The scan from few frames is the incomplete cloud, the scan from all of them the complete one.

    The incomplete cloud is a Poisson-disk sample of the scene's `partial`, with as many points as the complete
    cloud has where `partial` saw something: both have one density. A complete point counts as seen where `partial`
    has a point near; the others are what is missing, and their share is the case's level. Noise and drift of real
    scans stay in: the incomplete cloud is no part of the complete one. Chamfer and SSIM count only what the complete
    scan saw of what was completed.
    """

    class Options(options.Options):
        near_m: float = Field(
            0.03,
            gt=0,
            description="how near a point of the incomplete scan must be for a complete point to count as seen, metres "
            "(two spacings of the incomplete scan where that is more)",
        )

    options: Options
    has_levels = False

    def kept(self, scene: Scene, level: float, rng: np.random.Generator) -> NDArray[np.bool_]:
        """(N,) mask over `scene.complete` of the points that the incomplete scan saw too; `level` is passed over.

        Raises:
            Skipped: where the scene has no second scan, or the second scan misses nothing.
            CloudError: where the two scans have nothing in common.
        """
        partial = _partial(scene)
        reach_m = max(self.options.near_m, 2 * median_spacing(partial.points))
        distances, _ = nearest(scene.complete.points, partial.points)
        seen = distances <= reach_m
        if not seen.any():
            raise CloudError(
                f"{scene.name}: its incomplete scan is nowhere within {reach_m:.3g} m of the complete one; "
                "bring both into one frame and unit"
            )
        if seen.all():
            raise Skipped(f"the incomplete scan of {scene.name} misses nothing of the complete one")
        return seen

    def scan(self, scene: Scene, kept: NDArray[np.bool_], rng: np.random.Generator) -> PointCloud:
        """The incomplete scan, sampled as densely as the complete cloud."""
        partial = _partial(scene)
        return partial.select(poisson_disk_indices(partial.points, int(kept.sum()), rng))


def _partial(scene: Scene) -> PointCloud:
    if scene.partial is None:
        raise Skipped(
            f"{scene.name} has no incomplete scan of its own; give clouds.complete=FILE or rgbd.partial_frames=N"
        )
    return scene.partial
