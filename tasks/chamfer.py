"""Task `chamfer`: is the geometry right? Chamfer distance, its two sides, F-score, and the removed region alone."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from pcdbench import options
from pcdbench.case import Case
from pcdbench.cloud import PointCloud
from pcdbench.errors import PcdbenchError, Skipped
from pcdbench.geometry.chamfer import CloudDistances
from pcdbench.seen_space import judged
from pcdbench.task import Measurements, Metric, Task

NORMALIZED = "normalised, squared, both ways summed"


class Chamfer(Task):
    """Nearest distances between the completed and the complete cloud (docs/tasks/chamfer.md)."""

    class Options(options.Options):
        f_score_share: float = Field(
            0.01,
            gt=0,
            lt=1,
            description="how near a point must be to count for f_score, as a share of the longest side",
        )

    options: Options
    metrics = (
        Metric(
            "chd", NORMALIZED, "lower", "mean over p of min |p - q|^2 + mean over q of min |q - p|^2, longest side 1"
        ),
        Metric("accuracy_m", "m", "lower", "mean distance from a completed point to the nearest complete point"),
        Metric("completeness_m", "m", "lower", "mean distance from a complete point to the nearest completed point"),
        Metric("f_score", "share", "higher", "harmonic mean of the shares of points nearer than f_score_share"),
        Metric("hole_chd", NORMALIZED, "lower", "chd over the removed points and what was put where they were"),
    )

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        """One value a metric; nothing is random."""
        side_m = case.scene.longest_side_m
        if not side_m > 0:
            raise Skipped("the complete cloud has no extent to normalise by")
        if not len(completed):
            raise PcdbenchError("the completed cloud is empty: no distance can be measured")
        completed, trace = judged(case, completed)
        distances = CloudDistances.between(completed.points, case.scene.complete.points)
        return Measurements(
            {
                "chd": [distances.chamfer() / side_m**2],
                "accuracy_m": [float(distances.to_complete.mean())],
                "completeness_m": [float(distances.to_completed.mean())],
                "f_score": [distances.f_score(self.options.f_score_share * side_m)],
                "hole_chd": [distances.chamfer_within(~case.kept) / side_m**2],
            },
            trace=trace,
        )
