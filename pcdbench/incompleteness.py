"""The contract of an incompleteness: a way to take points away from a scene."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pcdbench import options as plugin_options
from pcdbench.scene import Scene


class Incompleteness(ABC):
    """A way to take points away from a scene, at a level, by a seed.

    Attributes:
        Options: the model of its options; `self.options` is an instance.
        version: raise it whenever other points are taken.
    """

    Options: ClassVar[type[plugin_options.Options]] = plugin_options.Options
    options: plugin_options.Options
    version: ClassVar[str] = "1"

    def __init__(self, options: plugin_options.Options | None = None) -> None:
        self.options = self.Options() if options is None else options

    @abstractmethod
    def kept(self, scene: Scene, level: float, rng: np.random.Generator) -> NDArray[np.bool_]:
        """(N,) mask over `scene.complete` of the points that are left.

        Args:
            level: the share to take away, in (0, 1); exactly round(level * N) points are taken.
            rng: the only source of randomness.
        """
