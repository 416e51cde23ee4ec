"""Localization: where is a device, from one scan of the true scene and the completed cloud as its map?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pcdbench import options
from pcdbench.case import Case
from pcdbench.cloud import PointCloud
from pcdbench.geometry.poses import Pose, absolute_errors, pose
from pcdbench.geometry.registration import Method, register
from pcdbench.geometry.scanning import ScannedScene, random_directions, scanned, shown
from pcdbench.geometry.surfels import occluded
from pcdbench.task import Measurements, Metric, Task

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Localization(Task):
    """Registers live scans at random locations to what the completed cloud shows from the scene's centre.

    Source: DeepPCD (IMWUT 2022), evaluation of localization. Where its text is silent see docs/tasks/localization.md.
    """

    class Options(options.Options):
        method: Method = Field("ndt", description="registration: ndt (published), icp (point to plane) or gicp")
        scales_m: tuple[Annotated[float, Field(gt=0)], ...] = Field(
            (2.0, 1.0, 0.5),
            min_length=1,
            description="coarse to fine: voxel sizes of ndt (0.2 m or less leave the guess), largest correspondence "
            "distances of icp and gicp",
        )
        locations: int = Field(10, ge=1, description="live scans a case")
        radius_m: float = Field(1.5, gt=0, description="locations lie at most this far from the reference position")
        yaw_deg: float = Field(
            5.0, ge=0, le=180, description="live headings differ from the reference's by at most this"
        )
        live_points: int = Field(2000, ge=20, description="rays of a live scan")
        noise_m: float = Field(0.01, ge=0, description="standard deviation of a live range, metres")
        max_range_m: float = Field(10.0, gt=0, description="range of both scans")
        vertical_fov_deg: float = Field(120.0, gt=0, lt=180, description="height of both panoramas")
        success_m: float = Field(0.1, gt=0, description="a location counts as found within this distance")

    options: Options
    metrics = (
        Metric("localization_error_m", "m", "lower", "|estimated - true location|, three axes", "mean"),
        Metric("localization_error_planar_m", "m", "lower", "the same, x and y alone", "mean"),
        Metric("rotation_error_deg", "deg", "lower", "angle between estimated and true orientation", "mean"),
        Metric("success", "share", "higher", "1 where localization_error_m is at most 0.1 (option success_m)", "mean"),
    )

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        """One sample a location.

        Raises:
            Skipped: where there is nowhere to stand in the scene.
        """
        place = scanned(case.scene)
        T_scene_reference = pose(place.center)
        T_scene_live, lives = self._live_scans(place, rng)
        view = (self.options.max_range_m, 360.0, self.options.vertical_fov_deg)
        reference = shown(place.map_of(completed.points), T_scene_reference, *view)
        method, scales_m = self.options.method, self.options.scales_m
        estimated = np.stack(
            [T_scene_reference @ register(live, reference, np.eye(4), method, scales_m) for live in lives]
        )
        estimated[~place.holds(estimated[:, :3, 3])] = T_scene_reference
        error_m, error_deg = absolute_errors(T_scene_live, estimated)
        planar = np.linalg.norm((estimated - T_scene_live)[:, :2, 3], axis=1)
        return Measurements(
            samples={
                "localization_error_m": error_m.tolist(),
                "localization_error_planar_m": planar.tolist(),
                "rotation_error_deg": error_deg.tolist(),
                "success": (error_m <= self.options.success_m).astype(float).tolist(),
            },
            trace={
                "reference": T_scene_reference[:3, 3].round(4).tolist(),
                "true": T_scene_live[:, :3, 3].round(4).tolist(),
                "estimated": estimated[:, :3, 3].round(4).tolist(),
            },
        )

    def figures(self, rows: pd.DataFrame) -> Mapping[str, Figure]:
        """The CDF of the error by completer, and estimated against true locations of one scene from above."""
        from .pose_figures import error_cdf, locations_from_above

        return {
            "cdf": error_cdf(rows, "localization_error_m", "localization error (m)"),
            "from_above": locations_from_above(rows),
        }

    def _live_scans(self, place: ScannedScene, rng: np.random.Generator) -> tuple[Pose, list[NDArray[np.float64]]]:
        """True poses (L, 4, 4) at random free places that see the reference position, and the scans from there."""
        near = _places_in_sight(place, self.options.radius_m)
        chosen = near[rng.choice(len(near), self.options.locations, replace=len(near) < self.options.locations)]
        yaws = np.radians(rng.uniform(-1, 1, len(chosen)) * self.options.yaw_deg)
        poses = np.stack([pose(position, yaw) for position, yaw in zip(chosen, yaws, strict=True)])
        scans = []
        for T_scene_live in poses:
            directions = random_directions(self.options.live_points, 360.0, self.options.vertical_fov_deg, rng)
            scans.append(place.scan(T_scene_live, directions, self.options.max_range_m, self.options.noise_m, rng))
        return poses, scans


def _places_in_sight(place: ScannedScene, radius_m: float) -> NDArray[np.float64]:
    """(P, 3) free positions within `radius_m` of the centre that nothing hides from it; the centre is one."""
    positions = place.at(place.free.centers)
    positions = positions[np.linalg.norm(positions - place.center, axis=1) <= radius_m]
    return positions[~occluded(place.raycaster, place.center, positions, tolerance_m=0.0)]
