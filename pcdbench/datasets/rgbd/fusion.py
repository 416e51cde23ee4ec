"""Fusing posed RGB-D into one cloud: Open3D's tensor voxel-block grid (a truncated signed distance field)."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.cloud import PointCloud
from pcdbench.datasets.rgbd.sequence import Camera, Frame, Sequence, is_rigid
from pcdbench.errors import CloudError
from pcdbench.geometry.poses import Pose, inverse
from pcdbench.open3d_loader import load_open3d
from pcdbench.threads import thread_count

# Kinects write the largest number where nothing came back.
_NO_RETURN = 65535
_BLOCK = 8
_BLOCKS = 20_000
# The grid's coordinates are float32: it lies about the multiple of this nearest to the first pose, so that at map
# coordinates voxels stay where they belong to 0.01 mm.
_ORIGIN_STEP_M = 256.0
# A point whose 8th neighbour is farther than this many voxels floats alone.
_LONELY_VOXELS = 4.0


@dataclass(frozen=True)
class Settings:
    """How to fuse.

    Attributes:
        voxel_m: edge of a voxel, metres.
        truncation_voxels: how far on either side of a surface distances are kept, in voxels.
        depth_max_m: depth beyond this is left out: it is too noisy.
        min_weight: in how many frames a point must have been seen.
    """

    voxel_m: float
    truncation_voxels: float
    depth_max_m: float
    min_weight: float


@dataclass(frozen=True, eq=False)
class Fused:
    """What came out of a sequence, in the poses' own world.

    Attributes:
        cloud: points and, where all frames used have colour images, colours.
        normals: (N, 3) unit normals of the points.
        T_world_depth: (F, 4, 4) the poses of the frames that were used.
        skipped: by reason, how many frames were not.
        median_depth_m: of the valid depth values of the frames used.
    """

    cloud: PointCloud
    normals: NDArray[np.float64]
    T_world_depth: NDArray[np.float64]
    skipped: Mapping[str, int]
    median_depth_m: float


def fused(sequence: Sequence, settings: Settings) -> Fused:
    """Fuse the frames of a sequence; those that cannot be used are skipped and counted.

    Raises:
        CloudError: where no frame can be used or nothing was seen.
    """
    open3d = load_open3d()
    tensor, dtype = open3d.core.Tensor, open3d.core.Dtype
    skipped: Counter[str] = Counter(sequence.unusable or {})
    grid, is_colored, origin = None, True, np.zeros(3)
    poses: list[Pose] = []
    medians: list[float] = []
    has_color = any(frame.color is not None for frame in sequence.frames)
    for frame, depth, camera in _usable_frames(sequence, skipped):
        colors = None
        if has_color:
            colors = _aligned_colors(sequence, frame, depth, camera)
            if colors is None:
                skipped["no readable colour image"] += 1
                continue
        if grid is None:
            is_colored = colors is not None
            grid = _grid(open3d, settings, is_colored)
        T_world_depth = _orthonormal(frame.T_world_depth)
        if not poses:
            origin = np.round(T_world_depth[:3, 3] / _ORIGIN_STEP_M) * _ORIGIN_STEP_M
        T_local_depth = T_world_depth.copy()
        T_local_depth[:3, 3] -= origin
        intrinsic = tensor(camera.matrix)
        extrinsic = tensor(inverse(T_local_depth))
        image = open3d.t.geometry.Image(tensor(depth))
        reach = (float(sequence.depth_scale), settings.depth_max_m, settings.truncation_voxels)
        try:
            blocks = grid.compute_unique_block_coordinates(image, intrinsic, extrinsic, *reach)
        except RuntimeError as error:
            # Of the pixels that Open3D looks at, each fourth of each fourth row, none is within reach.
            if "No block is touched" not in str(error):
                raise
            skipped[f"too little depth within {settings.depth_max_m:g} m"] += 1
            continue
        if colors is None:
            grid.integrate(blocks, image, intrinsic, extrinsic, *reach)
        else:
            picture = open3d.t.geometry.Image(tensor(colors))
            grid.integrate(blocks, image, picture, intrinsic, intrinsic, extrinsic, *reach)
        poses.append(T_world_depth)
        medians.append(float(np.median(depth[depth > 0])) / sequence.depth_scale)
    reasons = ", ".join(f"{count} with {reason}" for reason, count in skipped.items())
    if not poses:
        raise CloudError(f"{sequence.root}: none of its frames can be used ({reasons or 'there are none'})")
    found = _points_of(grid, settings.min_weight)
    if found is None:
        raise CloudError(
            f"{sequence.root}: no point was seen in {settings.min_weight:g} of its {len(poses)} usable frames within "
            f"{settings.depth_max_m:g} m{f' (left out: {reasons})' if reasons else ''}; check depth scale, poses, and "
            "the options min_weight and depth_max_m"
        )
    points = found.point.positions.to(dtype.Float64).numpy()
    normals = found.point.normals.to(dtype.Float64).numpy()
    colors = np.clip(found.point.colors.to(dtype.Float32).numpy(), 0, 1) if is_colored else None
    # Open3D's threads find voxels in any order.
    order = np.lexsort(points.T)
    kept = order[_together(points, _LONELY_VOXELS * settings.voxel_m)[order]]
    cloud = PointCloud(points + origin, colors).select(kept)
    return Fused(cloud, normals[kept], np.stack(poses), skipped, float(np.median(medians)))


def _usable_frames(sequence: Sequence, skipped: Counter[str]) -> Iterator[tuple[Frame, NDArray[np.uint16], Camera]]:
    """Frames whose pose and depth can be used, with the depth image and its camera; the others are counted."""
    seen: set[bytes] = set()
    for frame in sequence.frames:
        T = frame.T_world_depth
        if not np.isfinite(T).all():
            skipped["no pose (tracking was lost)"] += 1
        elif not is_rigid(T):
            skipped["a pose that is not rigid"] += 1
        elif (depth := _depth_image(frame.depth)) is None:
            skipped["no readable depth image"] += 1
        elif not depth.any():
            skipped["a depth of zero everywhere"] += 1
        elif (content := hashlib.sha256(depth.tobytes()).digest()) in seen:
            skipped["the same depth image as an earlier frame"] += 1
        else:
            seen.add(content)
            camera = frame.camera or sequence.depth_camera
            yield frame, depth, camera.scaled_to(depth.shape[1], depth.shape[0])


def _depth_image(path: Path) -> NDArray[np.uint16] | None:
    """(H, W) depth values, 0 where nothing came back; None where the file cannot be read.

    Raises:
        CloudError: where the image does not hold depth.
    """
    from skimage.io import imread

    try:
        image = np.asarray(imread(path))
    except (OSError, ValueError, SyntaxError):
        return None
    if image.ndim != 2 or image.dtype == np.uint8:
        raise CloudError(f"{path} is a picture of depth, not depth: it must be a 16-bit PNG with one channel")
    return np.where((image == _NO_RETURN) | (image < 0), 0, image).astype(np.uint16)


def _aligned_colors(
    sequence: Sequence, frame: Frame, depth: NDArray[np.uint16], camera: Camera
) -> NDArray[np.uint8] | None:
    """(H, W, 3) the colour that the colour camera saw at each depth pixel; None where it has no readable image.

    Depth that the colour camera did not see is set to 0 in `depth` itself.
    """
    from skimage.io import imread
    from skimage.transform import resize

    if frame.color is None:
        return None
    try:
        image = np.asarray(imread(frame.color))
    except (OSError, ValueError, SyntaxError):
        return None
    image = np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image[..., :3]
    height, width = depth.shape
    if sequence.color_camera is None:
        if image.shape[:2] == depth.shape:
            return np.ascontiguousarray(image)
        return np.rint(resize(image, (height, width), preserve_range=True)).astype(np.uint8)
    color_camera = sequence.color_camera.scaled_to(image.shape[1], image.shape[0])
    v, u = np.nonzero(depth)
    z = depth[v, u] / sequence.depth_scale
    points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=1)
    if sequence.T_color_depth is not None:
        # einsum: threads of a BLAS cost more than such narrow products.
        points = np.einsum("nj,ij->ni", points, sequence.T_color_depth[:3, :3]) + sequence.T_color_depth[:3, 3]
    ahead = np.maximum(points[:, 2], 1e-6)
    x = np.rint(color_camera.fx * points[:, 0] / ahead + color_camera.cx).astype(np.int64)
    y = np.rint(color_camera.fy * points[:, 1] / ahead + color_camera.cy).astype(np.int64)
    inside = (points[:, 2] > 0) & (x >= 0) & (x < image.shape[1]) & (y >= 0) & (y < image.shape[0])
    # A point without colour would be fused as a black one.
    depth[v[~inside], u[~inside]] = 0
    colors = np.zeros((height, width, 3), np.uint8)
    colors[v[inside], u[inside]] = image[y[inside], x[inside]]
    return colors


def _grid(open3d: Any, settings: Settings, is_colored: bool) -> Any:
    core = open3d.core
    # The combinations of types that Open3D integrates.
    names, types, shapes = ["tsdf", "weight"], [core.float32, core.float32], [(1,), (1,)]
    if is_colored:
        names, types, shapes = [*names, "color"], [core.float32, core.uint16, core.uint16], [*shapes, (3,)]
    return open3d.t.geometry.VoxelBlockGrid(
        names, types, shapes, settings.voxel_m, _BLOCK, _BLOCKS, core.Device("CPU:0")
    )


def _points_of(grid: Any, min_weight: float) -> Any:
    """Open3D's cloud of what at least so many frames saw, None where nothing is."""
    # Its threshold is exclusive, and weights are whole numbers of frames.
    threshold = max(min_weight - 0.5, 0.0)
    try:
        found = grid.extract_point_cloud(weight_threshold=threshold)
    except RuntimeError:
        # What Open3D 0.20 does where a grid without colours has no such point.
        return None
    return found if len(found.point.positions) else None


def _orthonormal(T: Pose) -> Pose:
    """The rigid transform nearest to one that text files rounded."""
    left, _, right = np.linalg.svd(T[:3, :3])
    result = T.copy()
    result[:3, :3] = left @ right
    result[3] = [0.0, 0.0, 0.0, 1.0]
    return result


def _together(points: NDArray[np.float64], reach_m: float) -> NDArray[np.bool_]:
    """(N,) mask of the points with eight others within reach."""
    if len(points) < 9:
        return np.ones(len(points), bool)
    distances, _ = cKDTree(points).query(points, k=9, distance_upper_bound=reach_m, workers=thread_count())
    return np.isfinite(distances[:, 8])
