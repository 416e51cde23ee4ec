"""The contract of an incompleteness: a way to take points away from a scene."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pcdbench import options as plugin_options
from pcdbench.cloud import PointCloud
from pcdbench.scene import Scene

MEASURED = 0.0
"""The level that stands in plans and rows for cases whose missing share is measured, not asked for."""
UNSEEN_SHARE = "unseen_share"
"""What a trace calls the share of a completed cloud that was left out: the complete scan could not judge it."""


class Incompleteness(ABC):
    """A way to take points away from a scene, at a level, by a seed.

    Attributes:
        Options: the model of its options; `self.options` is an instance.
        version: raise it whenever other points are taken.
        has_levels: False where the data decides how much is missing. There is then one case a scene and draw;
            `--level` does not apply, and the case's level is the share that is found missing.
    """

    Options: ClassVar[type[plugin_options.Options]] = plugin_options.Options
    options: plugin_options.Options
    version: ClassVar[str] = "1"
    has_levels: ClassVar[bool] = True

    def __init__(self, options: plugin_options.Options | None = None) -> None:
        self.options = self.Options() if options is None else options

    @abstractmethod
    def kept(self, scene: Scene, level: float, rng: np.random.Generator) -> NDArray[np.bool_]:
        """(N,) mask over `scene.complete` of the points that are left.

        Args:
            level: the share to take away, in (0, 1); exactly round(level * N) points are taken. To be passed
                over where `has_levels` is False.
            rng: the only source of randomness.
        """

    def scan(self, scene: Scene, kept: NDArray[np.bool_], rng: np.random.Generator) -> PointCloud | None:
        """The incomplete cloud, where it is a scan of its own; None where it is the kept part of the complete cloud.

        Args:
            kept: (N,) what `kept` returned for this scene.
            rng: the generator that `kept` drew from.
        """
        return None
