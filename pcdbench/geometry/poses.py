"""Poses as 4 x 4 transforms, and how far an estimated trajectory is from the true one.

`T_a_b` takes points of frame b into frame a. Sensor frames are x forward, y left, z up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Pose = NDArray[np.float64]


def pose(position: ArrayLike, yaw_rad: float = 0.0, pitch_rad: float = 0.0) -> Pose:
    """(4, 4) `T_scene_sensor` of a sensor at `position` (metres) that looks along `yaw_rad`.

    Args:
        yaw_rad: about z, from x towards y.
        pitch_rad: upwards is positive.
    """
    cos_yaw, sin_yaw = np.cos(yaw_rad), np.sin(yaw_rad)
    cos_pitch, sin_pitch = np.cos(pitch_rad), np.sin(pitch_rad)
    T_scene_sensor = np.eye(4)
    T_scene_sensor[:3, :3] = [
        [cos_yaw * cos_pitch, -sin_yaw, -cos_yaw * sin_pitch],
        [sin_yaw * cos_pitch, cos_yaw, -sin_yaw * sin_pitch],
        [sin_pitch, 0.0, cos_pitch],
    ]
    T_scene_sensor[:3, 3] = position
    return T_scene_sensor


def rotation_about(axis: str, angle_rad: float) -> NDArray[np.float64]:
    """(3, 3) right-handed rotation about a coordinate axis `x`, `y` or `z`."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    rotation = np.eye(3)
    rotation[first, first] = rotation[second, second] = cosine
    rotation[first, second], rotation[second, first] = -sine, sine
    return rotation


def transform(T_target_source: Pose, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The (N, 3) points of the source frame, in the target frame."""
    return points @ T_target_source[:3, :3].T + T_target_source[:3, 3]


def inverse(T_target_source: Pose) -> Pose:
    """`T_source_target`; works on a stack (..., 4, 4) too."""
    rotation = np.swapaxes(T_target_source[..., :3, :3], -1, -2)
    result = np.zeros_like(T_target_source)
    result[..., :3, :3] = rotation
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", rotation, T_target_source[..., :3, 3])
    result[..., 3, 3] = 1.0
    return result


def rotation_angles_deg(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """The angle (...,) in degrees that each (..., 3, 3) rotation turns by."""
    skew = rotations - np.swapaxes(rotations, -1, -2)
    sine = np.linalg.norm(np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1), axis=-1) / 2
    cosine = (np.trace(rotations, axis1=-2, axis2=-1) - 1) / 2
    return np.degrees(np.arctan2(sine, cosine))


def absolute_errors(true: Pose, estimated: Pose) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Absolute trajectory error of each pose, nothing aligned: (N,) metres and (N,) degrees.

    Args:
        true: (N, 4, 4).
        estimated: (N, 4, 4), in the same frame.
    """
    difference = inverse(true) @ estimated
    return np.linalg.norm(difference[:, :3, 3], axis=1), rotation_angles_deg(difference[:, :3, :3])


def relative_errors(true: Pose, estimated: Pose) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Relative trajectory error of each step: (N - 1,) metres and (N - 1,) degrees.

    Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems" (IROS 2012), equation 1.
    """
    true_motion = inverse(true[:-1]) @ true[1:]
    estimated_motion = inverse(estimated[:-1]) @ estimated[1:]
    return absolute_errors(true_motion, estimated_motion)
