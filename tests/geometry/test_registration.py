"""Registration: known motions are found, too little keeps the guess, and three methods agree on real scans."""

import numpy as np
import pytest

from pcdbench.cloud import PointCloud
from pcdbench.geometry.poses import absolute_errors, inverse, pose, transform
from pcdbench.geometry.registration import register

METHODS = {"ndt": (1.0, 0.5), "icp": (1.0, 0.3, 0.1), "gicp": (1.0, 0.3)}


def corner_room(seed, count=6000):
    """Points on the six faces of a box of 5 x 4 x 2.6 m and on a block in one of its corners."""
    rng = np.random.default_rng(seed)
    points = []
    for lower, upper in (((0, 0, 0), (5, 4, 2.6)), ((3.5, 2.8, 0), (5, 4, 1.4))):
        box = rng.uniform(lower, upper, (count // 2, 3))
        axis, side = rng.integers(3, size=len(box)), rng.integers(2, size=len(box))
        box[np.arange(len(box)), axis] = np.array([lower, upper], float)[side, axis]
        points.append(box)
    return np.concatenate(points) - [2.5, 2.0, 1.3] + rng.normal(0, 0.005, (count // 2 * 2, 3))


@pytest.mark.parametrize("method", METHODS)
def test_a_known_motion_is_found(method):
    T_target_source = pose([0.25, -0.15, 0.02], yaw_rad=0.06)
    source = transform(inverse(T_target_source), corner_room(1))
    found = register(source, corner_room(0), np.eye(4), method, METHODS[method])
    error_m, error_deg = absolute_errors(T_target_source[None], found[None])
    assert error_m[0] < 0.01
    assert error_deg[0] < 0.2


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [0, 1, 19])
def test_too_few_points_keep_the_guess(method, count):
    guess = pose([1, 2, 3], 0.5)
    assert (register(corner_room(0)[:count], corner_room(1), guess, method, METHODS[method]) == guess).all()
    assert (register(corner_room(0), corner_room(1)[:count], guess, method, METHODS[method]) == guess).all()


@pytest.mark.parametrize("method", METHODS)
def test_scans_without_overlap_still_give_a_rigid_pose(method):
    found = register(corner_room(0) + np.array([500.0, 0, 0]), corner_room(1), np.eye(4), method, METHODS[method])
    assert found[:3, :3] @ found[:3, :3].T == pytest.approx(np.eye(3), abs=1e-6)


def test_coarse_ndt_pulls_from_farther_away_than_walls_are_thick():
    """Walls of 5 mm noise, 70 cm off: without the regularisation that grows with the voxel it ends 30 cm off."""
    T_target_source = pose([-0.5, 0.5, 0.0], yaw_rad=0.05)
    source = transform(inverse(T_target_source), corner_room(1, 4000))
    found = register(source, corner_room(0, 4000), np.eye(4), "ndt", (1.0, 0.5))
    error_m, _ = absolute_errors(T_target_source[None], found[None])
    assert error_m[0] < 0.02


def thinned(points, edge_m):
    _, first = np.unique(np.floor(points / edge_m).astype(int), axis=0, return_index=True)
    return points[first]


def test_methods_agree_on_two_real_scans_of_one_room(real_data):
    target, source = (PointCloud.read(real_data / "pcl_rooms" / f"room_scan{number}.ply").points for number in (1, 2))
    # Thinned: otherwise the thousands of points close to the scanner outvote the far walls.
    target, source = (thinned(scan, 0.1) for scan in (target, source))
    # The initial guess of PCL's NDT tutorial: scan 2 in the frame of scan 1.
    guess = pose([1.79387, 0.720047, 0.0], yaw_rad=0.6931)
    found = [register(source, target, guess, method, scales_m) for method, scales_m in METHODS.items()]
    moved = np.array([np.abs(one - guess).max() for one in found])
    assert (moved > 1e-4).all()
    for one in found:
        error_m, error_deg = absolute_errors(np.stack([one] * 3), np.stack(found))
        assert error_m.max() < 0.02
        assert error_deg.max() < 0.5
