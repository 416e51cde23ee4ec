"""Up axes: every cloud becomes z-up by exchanging axes and signs, which is exact, and back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pcdbench.errors import PcdbenchError

Up = Literal["z", "y", "x", "-z", "-y", "-x"]
UPS: tuple[str, ...] = get_args(Up)


@dataclass(frozen=True)
class Frame:
    """Where a cloud's axes go so that z is up, right-handed.

    Attributes:
        axes: which of the cloud's axes become x, y and z.
        signs: their signs.
    """

    axes: tuple[int, int, int]
    signs: tuple[int, int, int]

    @classmethod
    def with_up(cls, up: str) -> Frame:
        """The frame of clouds whose up axis is `up`.

        Raises:
            PcdbenchError: for anything but an axis and its sign.
        """
        if up not in UPS:
            raise PcdbenchError(f"up axis {up!r} is none of {' '.join(UPS)}; --up y suits most phone apps")
        axis, sign = "xyz".index(up[-1]), -1 if up.startswith("-") else 1
        first, second = (axis + 1) % 3, (axis + 2) % 3
        # Cyclic orders are right-handed; turning z over exchanges x and y.
        axes = (first, second, axis) if sign > 0 else (second, first, axis)
        return cls(axes, (1, 1, sign))

    @property
    def up(self) -> str:
        """The cloud's axis that becomes z, as `with_up` takes it."""
        return ("" if self.signs[2] > 0 else "-") + "xyz"[self.axes[2]]

    def upright(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) a new array: the points with z up."""
        return points[:, self.axes] * np.array(self.signs, np.float64)

    def column(self, points: NDArray[np.float64], which: int) -> NDArray[np.float64]:
        """(N,) the upright points' x (0), y (1) or z (2) alone."""
        return points[:, self.axes[which]] * float(self.signs[which])

    def back(self, upright: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) upright points in the cloud's own frame."""
        points = np.empty_like(upright)
        points[:, self.axes] = upright * np.array(self.signs, np.float64)
        return points
