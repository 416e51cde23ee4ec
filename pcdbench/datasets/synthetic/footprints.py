"""What pieces take up on the floor, and which of them are near each other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from pcdbench.datasets.synthetic.plan import Floats

LARGEST_REACH_M = 4.5

_RIM = ((-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0))


@dataclass(frozen=True)
class Footprint:
    """A rectangle on the floor with a heading, and the heights between which something is there."""

    x: float
    y: float
    half_x: float
    half_y: float
    yaw_rad: float
    z0: float
    z1: float

    def corners(self) -> Floats:
        """(8, 2) its corners and the middles of its sides.

        What hangs on a wall touches it, and the last bit says whether it is in the room or not. So that bit depends
        neither on numpy's vectorised sines nor on matrix products, which round as a processor's instructions do.
        """
        cos, sin = self.heading
        rim = [(across * self.half_x, along * self.half_y) for across, along in _RIM]
        return np.array([(self.x + _fused(-b, sin, a * cos), self.y + _fused(b, cos, a * sin)) for a, b in rim])

    @cached_property
    def heading(self) -> tuple[float, float]:
        """The cosine and the sine of its yaw."""
        return math.cos(self.yaw_rad), math.sin(self.yaw_rad)

    @cached_property
    def radius(self) -> float:
        """Metres from the middle to a corner."""
        return float(np.hypot(self.half_x, self.half_y))

    def meets(self, other: Footprint, gap: float) -> bool:
        """Whether the two come closer than `gap`, by separating axes."""
        if self.z0 >= other.z1 or other.z0 >= self.z1:
            return False
        dx, dy = other.x - self.x, other.y - self.y
        reach = self.radius + other.radius + gap
        if dx * dx + dy * dy > reach * reach:
            return False
        turn = other.yaw_rad - self.yaw_rad
        c, s = abs(math.cos(turn)), abs(math.sin(turn))
        for one, b in ((self, other), (other, self)):
            ex, ey = one.half_x, one.half_y
            cos, sin = one.heading
            along, across = abs(dx * cos + dy * sin), abs(dy * cos - dx * sin)
            if along > ex + b.half_x * c + b.half_y * s + gap or across > ey + b.half_x * s + b.half_y * c + gap:
                return False
        return True

    def holds(self, points: Floats) -> bool:
        """Whether any of the (N, 2) points lies in it."""
        cos, sin = self.heading
        dx, dy = points[:, 0] - self.x, points[:, 1] - self.y
        return bool(((abs(dx * cos + dy * sin) < self.half_x) & (abs(dy * cos - dx * sin) < self.half_y)).any())


def _fused(a: float, b: float, c: float) -> float:
    """a b + c, rounded once (`math.fma` is there from Python 3.13 on)."""
    return float(Fraction(a) * Fraction(b) + Fraction(c))


class Footprints:
    """Footprints in the order they were added, those near a place found all at once."""

    def __init__(self) -> None:
        self._all: list[Footprint] = []
        # A column each: x, y, radius, z0, z1.
        self._columns = np.empty((5, 64))

    def __iter__(self) -> Iterator[Footprint]:
        return iter(self._all)

    def add(self, footprint: Footprint) -> None:
        """Add one."""
        count = len(self._all)
        if count == self._columns.shape[1]:
            self._columns = np.concatenate([self._columns, np.empty_like(self._columns)], axis=1)
        self._columns[:, count] = footprint.x, footprint.y, footprint.radius, footprint.z0, footprint.z1
        self._all.append(footprint)

    def near(self, footprint: Footprint, gap: float) -> Iterator[Footprint]:
        """Those whose circle and heights come closer than `gap` to the footprint's, middles at most 4.5 m apart."""
        x, y, radius, z0, z1 = self._columns[:, : len(self._all)]
        dx, dy = x - footprint.x, y - footprint.y
        reach = footprint.radius + radius + gap
        close = (dx * dx + dy * dy <= reach * reach) & (footprint.z0 < z1) & (z0 < footprint.z1)
        close &= (np.abs(dx) < LARGEST_REACH_M) & (np.abs(dy) < LARGEST_REACH_M)
        return (self._all[k] for k in close.nonzero()[0])
