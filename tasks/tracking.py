"""Tracking: does a device keep knowing where it is, step by step, with the completed cloud as its map?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from pcdbench import options
from pcdbench.case import Case
from pcdbench.cloud import PointCloud
from pcdbench.errors import Skipped
from pcdbench.geometry.freespace import headings
from pcdbench.geometry.poses import Pose, absolute_errors, inverse, pose, relative_errors
from pcdbench.geometry.registration import Method, register
from pcdbench.geometry.scanning import FieldOfView, ScannedScene, random_directions, scanned, shown
from pcdbench.geometry.surfels import SurfelCloud
from pcdbench.task import Measurements, Metric, Task

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

FIRMNESS_RAYS = 300
FIRMNESS_EVERY = 3  # views are judged every so many steps: neighbouring ones show the same


class Tracking(Task):
    """Registers each live scan of a walk to what the completed cloud shows from the pose estimated before.

    Source: DeepPCD (IMWUT 2022), evaluation of tracking. Where its text is silent see docs/tasks/tracking.md.
    """

    class Options(options.Options):
        method: Literal["ndt", "gicp", "kiss_icp"] = Field(
            "ndt", description="ndt (published) or gicp against the completed cloud; kiss_icp: odometry in it"
        )
        scales_m: tuple[Annotated[float, Field(gt=0)], ...] = Field(
            (1.0, 0.5),
            min_length=1,
            description="coarse to fine: voxel sizes of ndt (0.2 m or less leave the guess), largest correspondence "
            "distances of gicp",
        )
        constant_velocity: bool = Field(False, description="guess that the last motion goes on, not that it stopped")
        gate_m: float = Field(0.3, gt=0, description="a registration farther than this from its guess is not believed")
        gate_deg: float = Field(15.0, gt=0, description="the same for the angle, degrees")
        walks: int = Field(
            8, ge=1, description="walks drawn; the one taken is that whose views pin the device best in the true scene"
        )
        steps: int = Field(30, ge=1, description="steps of the walk after the first pose, which is known")
        step_m: float = Field(0.06, gt=0, description="length of a step")
        turn_deg: float = Field(2.0, ge=0, description="most that the heading changes in a step")
        fov_deg: FieldOfView = Field((77.0, 60.0), description="field of view, horizontal and vertical")
        reference_fov_deg: FieldOfView = Field((110.0, 90.0), description="what is cut from the completed cloud")
        max_range_m: float = Field(10.0, gt=0, description="range of both")
        live_points: int = Field(3000, ge=20, description="rays of a live scan")
        noise_m: float = Field(0.01, ge=0, description="standard deviation of a live range, metres")
        kiss_icp_voxel_m: float = Field(0.06, gt=0, description="voxel size of the local map of kiss_icp")

        @model_validator(mode="after")
        def _options_are_used(self) -> Self:
            registering = ("scales_m", "constant_velocity", "gate_m", "gate_deg", "reference_fov_deg")
            names = registering if self.method == "kiss_icp" else ("kiss_icp_voxel_m",)
            if unused := options.changed(self, *names):
                named = ", ".join(unused)
                raise ValueError(f"{named} would have no effect with method={self.method}; leave out what has none")
            return self

    options: Options
    metrics = (
        Metric("tracking_error_m", "m", "lower", "|estimated - true position| after each step, three axes", "mean"),
        Metric("rotation_error_deg", "deg", "lower", "angle between estimated and true orientation", "mean"),
        Metric("relative_error_m", "m", "lower", "|error of the motion over one step| (Sturm et al. 2012)", "mean"),
        Metric("final_drift_m", "m", "lower", "|estimated - true position| after the last step", "mean"),
    )

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        """One sample a step; the final drift is one a case.

        Raises:
            Skipped: where there is nowhere to walk in the scene.
        """
        place = scanned(case.scene)
        true = self._true_poses(place, rng)
        surfels = place.map_of(completed.points)
        provenance: dict[str, Any] = {}
        if self.options.method == "kiss_icp":
            from .odometry import kiss_icp_poses

            estimated, provenance = kiss_icp_poses(surfels, true, self.options, rng)
        else:
            estimated = self._registered_poses(place, surfels, true, rng)
        error_m, error_deg = absolute_errors(true, estimated)
        relative_m, _ = relative_errors(true, estimated)
        return Measurements(
            samples={
                "tracking_error_m": error_m[1:].tolist(),
                "rotation_error_deg": error_deg[1:].tolist(),
                "relative_error_m": relative_m.tolist(),
                "final_drift_m": [float(error_m[-1])],
            },
            trace={
                "true": true[:, :3, 3].round(4).tolist(),
                "estimated": estimated[:, :3, 3].round(4).tolist(),
                **provenance,
            },
        )

    def figures(self, rows: pd.DataFrame) -> Mapping[str, Figure]:
        """The error by step and its CDF by completer, and the tracked paths of one scene from above."""
        from .pose_figures import error_by_step, error_cdf, paths_from_above

        return {
            "cdf": error_cdf(rows, "tracking_error_m", "tracking error (m)"),
            "error_by_step": error_by_step(rows),
            "path": paths_from_above(rows),
        }

    def _true_poses(self, place: ScannedScene, rng: np.random.Generator) -> Pose:
        """(steps + 1, 4, 4) poses of a device carried along a walk, of several drawn the best to track.

        A view that could slide along what it shows (one bare wall, the open end of the scanned part) loses the
        device in the truth itself, and says nothing about completion.
        """
        directions = random_directions(FIRMNESS_RAYS, *self.options.fov_deg, rng)
        walks = [self._walk_poses(place, rng) for _ in range(self.options.walks)]
        firmest = [place.firmness(walk[::FIRMNESS_EVERY], directions, self.options.max_range_m).min() for walk in walks]
        return walks[int(np.argmax(firmest))]

    def _walk_poses(self, place: ScannedScene, rng: np.random.Generator) -> Pose:
        """(steps + 1, 4, 4) poses along one random walk, facing where it goes but turning slowly."""
        count, step_m = self.options.steps + 1, self.options.step_m
        # Rounding the corners shortens a walk, so that more than one try may be needed.
        for tries in range(1, 6):
            walk = place.free.walk(2**tries * count * step_m / 2, step_m, rng)
            if len(walk) >= count:
                break
        else:
            raise Skipped(f"the free space is too narrow for a walk of {count * step_m:.1f} m")
        ahead = headings(walk)[:count]
        turns = np.radians(self.options.turn_deg)
        yaws = [ahead[0]]
        for heading in ahead[1:]:
            away = (heading - yaws[-1] + np.pi) % (2 * np.pi) - np.pi
            yaws.append(yaws[-1] + np.clip(away, -turns, turns))
        return np.stack([pose(position, yaw) for position, yaw in zip(place.at(walk[:count]), yaws, strict=True)])

    def _registered_poses(
        self, place: ScannedScene, surfels: SurfelCloud, true: Pose, rng: np.random.Generator
    ) -> Pose:
        """(N, 4, 4) estimated poses: the first is known, each later one is registered to the one before."""
        method: Method = "gicp" if self.options.method == "gicp" else "ndt"
        estimated = [true[0]]
        motion = np.eye(4)
        for T_scene_live in true[1:]:
            directions = random_directions(self.options.live_points, *self.options.fov_deg, rng)
            live = place.scan(T_scene_live, directions, self.options.max_range_m, self.options.noise_m, rng)
            reference = shown(surfels, estimated[-1], self.options.max_range_m, *self.options.reference_fov_deg)
            guess = motion if self.options.constant_velocity else np.eye(4)
            found = register(live, reference, guess, method, self.options.scales_m)
            away_m, away_deg = absolute_errors(guess[None], found[None])
            believed = away_m[0] <= self.options.gate_m and away_deg[0] <= self.options.gate_deg
            T_before_live = found if believed else guess
            estimated.append(estimated[-1] @ T_before_live)
            motion = inverse(estimated[-2]) @ estimated[-1]
        return np.stack(estimated)
