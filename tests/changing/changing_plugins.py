"""A completer and a task that change without saying so, as a pull request would change them: by `planted`."""

import time
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pcdbench import Case, Completer, Measurements, Metric, PointCloud, Register, Task, hookimpl


@dataclass
class Planted:
    """What is changed."""

    drop: float = 0.0
    voxel_m: float = 0.25
    seconds: float = 0.03
    noise: int | None = None


planted = Planted()


@hookimpl
def register_completers(register: Register) -> None:
    register("changing_fill", "changing_plugins:Fill", "adds points at random")


@hookimpl
def register_tasks(register: Register) -> None:
    register("changing_gap", "changing_plugins:Gap", "how far the truth is from the completed cloud")
    register("changing_voxels", "changing_plugins:Voxels", "share of the true voxels that are filled")


class Fill(Completer):
    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        draws = (
            rng
            if planted.noise is None
            else np.random.default_rng([planted.noise, len(cloud), int(cloud.points.sum() * 1e6)])
        )
        time.sleep(planted.seconds * draws.uniform(0.8, 1.4))
        low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
        filled = PointCloud.concatenate(
            [cloud.without_colors(), PointCloud(low + draws.random((40, 3)) * (high - low))]
        )
        kept = np.random.default_rng(len(cloud)).random(len(filled)) >= planted.drop
        return filled.select(np.flatnonzero(kept))


class Gap(Task):
    caps_density = False
    metrics = (Metric("gap_m", "m", "lower", "mean distance from the complete to the completed cloud", "mean"),)

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        return Measurements({"gap_m": [cKDTree(completed.points).query(case.scene.complete.points)[0].mean()]})


class Voxels(Task):
    caps_density = False
    metrics = (Metric("filled", "share", "higher", "share of the voxels of the truth that have a completed point"),)

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        true, found = (
            {tuple(voxel) for voxel in np.floor(points / planted.voxel_m).astype(int)}
            for points in (case.scene.complete.points, completed.points)
        )
        return Measurements({"filled": [len(true & found) / len(true)]})
