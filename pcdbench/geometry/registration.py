"""Registration of two scans: NDT, point-to-plane ICP and GICP, coarse to fine, from a guess.

All return `T_target_source`, all keep the guess where there is too little to register: a pose is judged by where it
is, never by the fitness a method claims for itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pcdbench.geometry.poses import Pose
from pcdbench.open3d_loader import load_open3d

Method = Literal["ndt", "icp", "gicp"]
FEWEST_POINTS = 20


def register(
    source: NDArray[np.float64],
    target: NDArray[np.float64],
    T_target_source: Pose,
    method: Method,
    scales_m: Sequence[float],
) -> Pose:
    """The refined `T_target_source`, by a method.

    Args:
        source: (N, 3) metres, in the source's own frame.
        target: (M, 3) metres, in the target's frame.
        T_target_source: (4, 4) the guess; returned as it is where either scan has fewer than 20 points or the
            method finds nothing to hold on to.
        scales_m: coarse to fine: voxel sizes of NDT, largest correspondence distances of the others.
    """
    if min(len(source), len(target)) < FEWEST_POINTS:
        return T_target_source
    methods: dict[Method, Callable[..., Pose]] = {"ndt": ndt, "icp": icp, "gicp": gicp}
    align = methods[method]
    return align(source, target, T_target_source, scales_m)


def ndt(
    source: NDArray[np.float64],
    target: NDArray[np.float64],
    T_target_source: Pose,
    voxel_sizes_m: Sequence[float] = (1.0, 0.5),
) -> Pose:
    """Normal distributions transform (Magnusson 2009; Open3D), one pass a voxel size.

    Voxels much below 0.5 m leave the guess untouched without saying so; 1.0 then 0.5 m works best indoors. Walls
    make distributions as thin as their noise, which pull from near by alone: those of coarse voxels are made
    thicker (the regularisation grows with the voxel's volume), and pull from farther away.
    """
    o3d = load_open3d()
    registration = o3d.pipelines.registration
    source_cloud, target_cloud = _open3d_cloud(source), _open3d_cloud(target)
    result = T_target_source
    for voxel_size in voxel_sizes_m:
        option = registration.NormalDistributionsTransformOption()
        option.voxel_size = voxel_size
        option.covariance_regularization = 0.01 * voxel_size**3
        try:
            found = registration.registration_ndt(source_cloud, target_cloud, option, result)
        except RuntimeError:
            # Open3D raises where no voxel holds enough points for a distribution.
            continue
        result = _sane(found.transformation, result)
    return result


def icp(
    source: NDArray[np.float64],
    target: NDArray[np.float64],
    T_target_source: Pose,
    distances_m: Sequence[float] = (1.0, 0.3, 0.1),
    iterations: int = 30,
) -> Pose:
    """Point-to-plane ICP (Chen and Medioni 1991; Open3D), one pass a largest correspondence distance."""
    o3d = load_open3d()
    registration = o3d.pipelines.registration
    source_cloud, target_cloud = _open3d_cloud(source), _open3d_cloud(target)
    target_cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(12))
    result = T_target_source
    for distance in distances_m:
        found = registration.registration_icp(
            source_cloud,
            target_cloud,
            distance,
            result,
            registration.TransformationEstimationPointToPlane(),
            registration.ICPConvergenceCriteria(max_iteration=iterations),
        )
        result = _sane(found.transformation, result)
    return result


def gicp(
    source: NDArray[np.float64],
    target: NDArray[np.float64],
    T_target_source: Pose,
    distances_m: Sequence[float] = (1.0, 0.3),
    downsampling_m: float = 0.05,
) -> Pose:
    """Generalized ICP (Segal et al. 2009; small_gicp), one pass a largest correspondence distance."""
    import small_gicp

    # With more threads it adds up in any order, and the same scans give other digits.
    threads = 1
    # small_gicp's voxel grid ends at 2^20 cells: map coordinates have to be taken off first.
    offset = target.mean(axis=0)
    target_cloud, tree = small_gicp.preprocess_points(target - offset, downsampling_m, num_threads=threads)
    center = source.mean(axis=0)
    source_cloud, _ = small_gicp.preprocess_points(source - center, downsampling_m, num_threads=threads)
    if min(target_cloud.size(), source_cloud.size()) < FEWEST_POINTS:
        return T_target_source
    result = _recentered(T_target_source, -offset, center)
    for distance in distances_m:
        found = small_gicp.align(
            target_cloud,
            source_cloud,
            tree,
            result,
            max_correspondence_distance=distance,
            num_threads=threads,
            max_iterations=30,
        )
        result = _sane(found.T_target_source, result)
    return _recentered(result, offset, -center)


def _recentered(T_target_source: Pose, target_shift: NDArray[np.float64], source_shift: NDArray[np.float64]) -> Pose:
    """The transform after the target frame's points moved by `target_shift` and its input by `source_shift`."""
    before, after = np.eye(4), np.eye(4)
    before[:3, 3], after[:3, 3] = source_shift, target_shift
    return after @ T_target_source @ before


def _sane(found: NDArray[np.float64], guess: Pose) -> Pose:
    return np.array(found) if np.isfinite(found).all() else guess


def _open3d_cloud(points: NDArray[np.float64]) -> Any:
    o3d = load_open3d()
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.array(points)))
