"""Odometry by kiss-icp over scans of the completed cloud: does what was completed hold together as one moves?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pcdbench.geometry.poses import Pose
from pcdbench.geometry.scanning import cast_scan, random_directions
from pcdbench.geometry.surfels import SurfelCloud

if TYPE_CHECKING:
    from .tracking import Tracking


def kiss_icp_poses(
    surfels: SurfelCloud, true: Pose, options: Tracking.Options, rng: np.random.Generator
) -> tuple[Pose, dict[str, Any]]:
    """Estimated poses (N, 4, 4) along the true ones, the first of which is known, and the configuration used.

    Each scan is cast on the surfels of the completed cloud with rays and noise of its own, so that no two scans
    share a point.

    Args:
        true: (N, 4, 4) `T_scene_sensor`.
    """
    from kiss_icp.config import load_config
    from kiss_icp.kiss_icp import KissICP

    config = load_config(None)
    config.data.max_range, config.data.min_range, config.data.deskew = options.max_range_m, 0.1, False
    # After the rest: loading the configuration sets it to a hundredth of the default range.
    config.mapping.voxel_size = options.kiss_icp_voxel_m
    # More threads add up in any order: the same scans would give other digits.
    config.registration.max_num_threads = 1
    odometry = KissICP(config)
    estimated = []
    for T_scene_sensor in true:
        directions = random_directions(options.live_points, *options.fov_deg, rng)
        points = cast_scan(surfels.raycaster, T_scene_sensor, directions, options.max_range_m, options.noise_m, rng)
        if len(points):
            odometry.register_frame(points, np.zeros(len(points)))
        estimated.append(true[0] @ odometry.last_pose)
    recorded = config.model_dump()
    recorded.pop("out_dir")
    recorded["registration"].pop("max_num_threads")
    return np.stack(estimated), {"kiss_icp": recorded}
