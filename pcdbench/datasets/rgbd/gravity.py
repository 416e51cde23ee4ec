"""Which way is up: from the planes of a room, and from the fact that people hold cameras upright."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcdbench.geometry.freespace import floor_height
from pcdbench.geometry.poses import Pose

# Indoor cameras pitch and roll; their mean up lies this near to the true one.
_FARTHEST_DEG = 50.0
_STEP_DEG = 3.0
# A normal this near to a direction, or to its plane, votes for it.
_VOTE_DEG = 6.0
_ROUNDS = 8
_MOST_NORMALS = 10_000


def up_direction(normals: NDArray[np.float64], likely: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) unit vector: the direction that most surfaces are level or upright to (a Manhattan vote).

    Floors, ceilings and table tops have normals along it, walls and fronts across it. The best of the directions
    around `likely` is refined by least squares over the normals that vote for it.

    Args:
        normals: (N, 3) unit normals of surface points, of either sign.
        likely: (3,) the mean up of the cameras: it decides the sign, and which of a room's three axes is meant.
    """
    likely = likely / np.linalg.norm(likely)
    normals = normals[:: -(-len(normals) // _MOST_NORMALS)]
    candidates = _around(likely)
    votes = np.array([_votes(normals, candidate).sum() for candidate in candidates])
    up = candidates[int(np.argmax(votes))]
    for _ in range(_ROUNDS):
        level, upright = _level_and_upright(normals, up)
        # Smallest eigenvector: level normals along it, upright ones across it.
        scatter = normals[upright].T @ normals[upright] - normals[level].T @ normals[level]
        up = np.linalg.eigh(scatter)[1][:, 0]
        up = up if up @ likely > 0 else -up
    return up


def levelled(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) the smallest rotation that takes the unit vector `up` to z."""
    cosine = float(up[2])
    if cosine < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    x, y = up[0], up[1]
    return np.array(
        [
            [1 - x * x / (1 + cosine), -x * y / (1 + cosine), -x],
            [-x * y / (1 + cosine), 1 - y * y / (1 + cosine), -y],
            [x, y, cosine],
        ]
    )


def T_zup(points: NDArray[np.float64], up: NDArray[np.float64]) -> Pose:
    """(4, 4) that turns `up` to z and brings the floor of (N, 3) points to height 0."""
    T_zup_world = np.eye(4)
    T_zup_world[:3, :3] = levelled(up)
    T_zup_world[2, 3] = -floor_height(points @ T_zup_world[:3, :3].T)
    return T_zup_world


def _level_and_upright(
    normals: NDArray[np.float64], up: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    along = np.abs(normals @ up)
    return along > np.cos(np.radians(_VOTE_DEG)), along < np.sin(np.radians(_VOTE_DEG))


def _votes(normals: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) how much each normal speaks for a direction: 1 if it lies across, 19 if it lies along it, else 0.

    Of random normals 19 times as many lie that near to a plane as to its axis: the weight makes up for that.
    """
    level, upright = _level_and_upright(normals, up)
    limit = np.radians(_VOTE_DEG)
    return level / (1 - np.cos(limit)) * np.sin(limit) + upright


def _around(likely: NDArray[np.float64]) -> NDArray[np.float64]:
    """(C, 3) unit vectors, about `_STEP_DEG` apart, within `_FARTHEST_DEG` of a direction."""
    tilts = np.radians(np.arange(0.0, _FARTHEST_DEG + _STEP_DEG, _STEP_DEG))
    directions = []
    for tilt in tilts:
        count = max(1, round(2 * np.pi * np.sin(tilt) / np.radians(_STEP_DEG)))
        angles = 2 * np.pi * np.arange(count) / count
        ring = [np.sin(tilt) * np.cos(angles), np.sin(tilt) * np.sin(angles), np.full(count, np.cos(tilt))]
        directions.append(np.stack(ring, axis=1))
    return np.concatenate(directions) @ levelled(likely)
