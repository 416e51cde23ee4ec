"""The task `coverage`: how much of the complete cloud has a completed point nearby."""

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from pcdbench import Case, Measurements, Metric, Options, PointCloud, Task


class Coverage(Task):
    """The share of the complete cloud's points with a completed point within reach, and the widest gap."""

    class Options(Options):
        """What counts as nearby."""

        reach_m: float = Field(0.05, gt=0, description="a point this near counts as covering, metres")

    options: Options
    version = "1"
    metrics = (
        Metric("covered", "share", "higher", "share of complete points with a completed point within reach_m", "mean"),
        Metric("widest_gap_m", "m", "lower", "largest distance from a complete point to the nearest completed one"),
    )

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        """One value of each metric a case."""
        center = case.scene.complete.points.mean(axis=0)
        distances, _ = cKDTree(completed.points - center).query(case.scene.complete.points - center)
        covered = float(np.mean(distances <= self.options.reach_m))
        return Measurements({"covered": [covered], "widest_gap_m": [float(distances.max())]})
