"""How far two clouds are apart: nearest distances both ways, and the figures made of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcdbench.geometry.neighbors import nearest


@dataclass(frozen=True, eq=False)
class CloudDistances:
    """Nearest distances between a completed cloud (M points) and the complete one (N points), both ways.

    Attributes:
        to_complete: (M,) metres from each completed point to the nearest complete point.
        nearest_complete: (M,) index of that complete point.
        to_completed: (N,) metres from each complete point to the nearest completed point.
    """

    to_complete: NDArray[np.float64]
    nearest_complete: NDArray[np.int64]
    to_completed: NDArray[np.float64]

    @classmethod
    def between(cls, completed: NDArray[np.float64], complete: NDArray[np.float64]) -> CloudDistances:
        """Measure (M, 3) completed against (N, 3) complete points, metres; neither may be empty."""
        to_complete, nearest_complete = nearest(completed, complete)
        to_completed, _ = nearest(complete, completed)
        return cls(to_complete, nearest_complete, to_completed)

    def chamfer(self) -> float:
        """Chamfer distance, square metres: mean squared distance one way plus the other (Fan et al. 2017)."""
        return float(np.mean(self.to_complete**2) + np.mean(self.to_completed**2))

    def f_score(self, threshold_m: float) -> float:
        """F-score at a distance: the harmonic mean of the shares of points that lie that near, each way.

        Knapitsch et al. (2017), Tanks and Temples, equations 3 to 5.
        """
        precision = float(np.mean(self.to_complete < threshold_m))
        recall = float(np.mean(self.to_completed < threshold_m))
        return 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0

    def chamfer_within(self, region: NDArray[np.bool_]) -> float:
        """Chamfer distance, square metres, over a region of the complete cloud alone.

        A completed point lies in the region where its nearest complete point does. The region's points are
        looked for in the whole completed cloud: the value is finite even where nothing was put, and putting
        a right point never makes it worse. Where nothing was put only this direction is left; for an empty
        region the value is 0.

        Args:
            region: (N,) mask over the complete cloud.
        """
        missing = self.to_completed[region]
        added = self.to_complete[region[self.nearest_complete]]
        return sum(float(np.mean(distances**2)) for distances in (missing, added) if len(distances))
