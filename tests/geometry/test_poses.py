"""Poses: hand-computed transforms, and trajectory errors that agree with evo."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pcdbench.geometry.poses import (
    absolute_errors,
    inverse,
    pose,
    relative_errors,
    rotation_about,
    rotation_angles_deg,
    transform,
)


def trajectory(seed, count=20):
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(rng.normal(0, 0.7, (count, 3))).as_matrix()
    poses[:, :3, 3] = rng.normal(0, 2, (count, 3))
    return poses


def test_a_sensor_turned_left_sees_forward_along_y():
    T_scene_sensor = pose([1.0, 2.0, 3.0], yaw_rad=np.pi / 2)
    assert transform(T_scene_sensor, np.array([[2.0, 0, 0], [0, 1.0, 0]])) == pytest.approx(
        np.array([[1.0, 4.0, 3.0], [0.0, 2.0, 3.0]])
    )


def test_a_sensor_pitched_up_sees_forward_upwards():
    assert transform(pose([0, 0, 0], pitch_rad=np.pi / 2), np.array([[1.0, 0, 0]])) == pytest.approx(
        np.array([[0.0, 0, 1.0]])
    )


@given(st.floats(-3, 3), st.floats(-1.5, 1.5))
def test_a_pose_is_a_rigid_motion(yaw, pitch):
    T = pose([1, 2, 3], yaw, pitch)
    assert T[:3, :3] @ T[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)


def test_inverse_of_a_stack():
    assert inverse(trajectory(0)) @ trajectory(0) == pytest.approx(np.tile(np.eye(4), (20, 1, 1)), abs=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.5, 90.0, 179.9, 180.0])
def test_rotation_angles_are_exact_from_tiny_to_half_turns(angle):
    axis = np.array([1.0, 2.0, -1.0]) / np.sqrt(6)
    assert rotation_angles_deg(Rotation.from_rotvec(np.radians(angle) * axis).as_matrix()) == pytest.approx(
        angle, rel=1e-6, abs=1e-9
    )


def test_drift_that_grows_by_a_centimetre_a_step():
    true = np.stack([pose([0.1 * step, 0, 0]) for step in range(5)])
    estimated = np.stack([pose([0.11 * step, 0, 0]) for step in range(5)])
    assert absolute_errors(true, estimated)[0] == pytest.approx([0, 0.01, 0.02, 0.03, 0.04])
    assert relative_errors(true, estimated)[0] == pytest.approx([0.01] * 4)


def test_trajectory_errors_agree_with_evo():
    metrics = pytest.importorskip("evo.core.metrics", reason="evo (GPL) is a cross-check only; pip install evo")
    from evo.core.trajectory import PosePath3D

    true, estimated = trajectory(1), trajectory(2)
    data = (PosePath3D(poses_se3=list(true)), PosePath3D(poses_se3=list(estimated)))
    relations = (metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_deg)
    for ours, relation in zip(absolute_errors(true, estimated), relations, strict=True):
        theirs = metrics.APE(relation)
        theirs.process_data(data)
        assert ours == pytest.approx(theirs.error)
    for ours, relation in zip(relative_errors(true, estimated), relations, strict=True):
        theirs = metrics.RPE(relation, 1, metrics.Unit.frames, all_pairs=True)
        theirs.process_data(data)
        assert ours == pytest.approx(theirs.error)


@pytest.mark.parametrize(("axis", "one", "other"), [("x", 1, 2), ("y", 2, 0), ("z", 0, 1)])
def test_a_turn_about_an_axis_leads_from_the_next_one_to_the_one_after(axis, one, other):
    np.testing.assert_allclose(rotation_about(axis, np.pi / 2) @ np.eye(3)[one], np.eye(3)[other], atol=1e-15)


def test_a_turn_about_z_leads_from_x_towards_y():
    np.testing.assert_allclose(rotation_about("z", np.pi / 2) @ (1.0, 0.0, 2.0), (0.0, 1.0, 2.0), atol=1e-15)
