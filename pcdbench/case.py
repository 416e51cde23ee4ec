"""The case: a scene made incomplete, which is what a completer gets to see (its cloud) and a task measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import PcdbenchError
from pcdbench.incompleteness import Incompleteness
from pcdbench.scene import Scene


@dataclass(frozen=True, eq=False)
class Case:
    """A scene made incomplete.

    Attributes:
        scene: the scene, complete.
        incompleteness: the name of what took points away.
        level: the share of the complete cloud that is missing, in (0, 1); of a real pair, as measured.
        seed: the draw; the same seed takes the same points.
        kept: (N,) mask over `scene.complete` of the points that are left; of a real pair, of those that the
            incomplete scan saw too.
        scan: the incomplete cloud where it is a scan of its own (a real pair), else None.
    """

    scene: Scene
    incompleteness: str
    level: float
    seed: int
    kept: NDArray[np.bool_]
    scan: PointCloud | None = None

    @property
    def cloud(self) -> PointCloud:
        """The completer's input: what is left of the complete cloud, or the incomplete scan of a real pair."""
        return self.scene.complete.select(self.kept) if self.scan is None else self.scan

    @property
    def removed(self) -> PointCloud:
        """What was taken away: the region that a completer is asked for."""
        return self.scene.complete.select(~self.kept)


def make_case(scene: Scene, name: str, incompleteness: Incompleteness, level: float, seed: int) -> Case:
    """Take points away from `scene`, at `level`, by `seed`; the same arguments give the same case.

    Args:
        name: the name the incompleteness is registered under, kept in the case.
        level: passed over where the incompleteness has no levels; the case has the measured one.

    Raises:
        PcdbenchError: where the level is not in (0, 1) or the incompleteness breaks its contract.
    """
    if incompleteness.has_levels and not 0.0 < level < 1.0:
        raise PcdbenchError(f"level must lie between 0 and 1 (a share of the cloud), not {level}")
    rng = np.random.default_rng(seed)
    kept = np.asarray(incompleteness.kept(scene, level, rng))
    if kept.shape != (len(scene.complete),) or kept.dtype != np.bool_:
        raise PcdbenchError(
            f"incompleteness {name!r} must return a boolean mask over the {len(scene.complete)} complete points, "
            f"not {kept.dtype} of shape {kept.shape}"
        )
    taken, wanted = int((~kept).sum()), round(level * len(kept))
    if incompleteness.has_levels and taken != wanted:
        raise PcdbenchError(
            f"incompleteness {name!r} must take away exactly round(level * N) points, {wanted} of {len(kept)} at level "
            f"{level:g}, not {taken}; where the data decides how many, set has_levels = False"
        )
    if not incompleteness.has_levels:
        level = 1.0 - float(kept.mean())
    return Case(scene, name, level, seed, kept, incompleteness.scan(scene, kept, rng))
