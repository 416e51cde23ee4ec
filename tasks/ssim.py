"""Task `ssim`: does it look right? Structural similarity of the cloud's six faces with those of the truth."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from pcdbench import options
from pcdbench.case import Case
from pcdbench.cloud import PointCloud
from pcdbench.errors import Skipped
from pcdbench.geometry.projection import six_face_similarity
from pcdbench.geometry.voxels import VoxelGrid, edge_from_density, voxelize
from pcdbench.seen_space import judged
from pcdbench.task import Measurements, Metric, Task


class Ssim(Task):
    """Six-face SSIM of the completed and the complete cloud (docs/tasks/ssim.md)."""

    class Options(options.Options):
        voxel_spacings: float = Field(
            5.0, gt=0, description="voxel edge, in median nearest-neighbour distances of the complete cloud"
        )
        voxel_points: int = Field(
            2, ge=1, description="points a voxel must hold to be seen, so that strays do not hide what is behind"
        )

    options: Options
    needs_color = True
    metrics = (
        Metric("ssim", "SSIM, at most 1", "higher", "mean SSIM of the colour images of the voxels from six sides"),
    )

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        """One value; nothing is random."""
        complete = case.scene.complete
        completed, trace = judged(case, completed)
        if complete.colors is None or completed.colors is None:
            raise Skipped("ssim compares colours, and the cloud has none")
        edge_m = edge_from_density(complete.points, self.options.voxel_spacings)
        if not edge_m > 0:
            raise Skipped("the complete cloud has no two distinct points, so no resolution to look at it")
        # A margin of one voxel, empty in the truth, takes what was put outside and shows it in front of the room.
        low, high = complete.points.min(axis=0) - edge_m, complete.points.max(axis=0) + edge_m
        grid = VoxelGrid.covering(low, high, edge_m)
        truth = voxelize(complete.points, complete.colors, grid, self.options.voxel_points)
        if not len(truth.index):
            raise Skipped(
                f"no voxel holds {self.options.voxel_points} points of the complete cloud: it is too thin to see"
            )
        answer = voxelize(completed.points, completed.colors, grid, self.options.voxel_points)
        return Measurements({"ssim": [six_face_similarity(answer, truth)]}, trace=trace)
