"""The triangles that span the holes of a cloud's mesh of near neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree

from pcdbench.threads import thread_count

RIM_NEIGHBORS = 24
JITTER = 1e-4
_FACES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
_EDGES = np.array([[1, 2], [0, 2], [0, 1]])


def hole_triangles(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    *,
    link_m: float,
    max_edge_m: float,
    min_gap_deg: float,
    min_cosine: float,
    emptiness: float,
    rng: np.random.Generator,
) -> NDArray[np.int64]:
    """(T, 3) rows of `points`: Delaunay triangles that join the rims of holes and go on where the surface left off.

    A triangle is one where all corners are rim points, its longest edge is longer than `link_m` (it is no part
    of the mesh of near neighbours) but not than `max_edge_m`, its plane is that of the surface at all three
    corners, and the ball around it is empty (a Gabriel triangle, as surface reconstruction takes them).

    Args:
        points: (N, 3) metres, near the origin, N at least 4.
        normals: (N, 3) unit normals, of either sign.
        link_m: the longest edge of the mesh of near neighbours.
        min_gap_deg: see `rim_points`.
        min_cosine: of the angle between a triangle's normal and each corner's.
        emptiness: share of the radius of the triangle's smallest circumscribed ball that must be empty.
        rng: moves points a little, so that gridded and planar clouds have a triangulation.
    """
    nothing = np.empty((0, 3), np.int64)
    rim = rim_points(points, normals, link_m, min_gap_deg)
    try:
        tetrahedra = Delaunay(points + rng.uniform(-1, 1, points.shape) * JITTER * link_m).simplices
    except QhullError:
        return nothing
    faces = tetrahedra[:, _FACES].reshape(-1, 3)
    opposite = tetrahedra.ravel()
    kept = np.flatnonzero(rim[faces].all(axis=1))
    edges = _edge_lengths(points, faces[kept])
    kept = kept[(edges.max(axis=1) > link_m) & (edges.max(axis=1) <= max_edge_m)]
    corners = points[faces[kept]]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    tilt = np.abs(np.einsum("nki,ni->nk", normals[faces[kept]], cross)).min(axis=1)
    kept = kept[(tilt >= min_cosine * np.linalg.norm(cross, axis=1)) & cross.any(axis=1)]
    if not len(kept):
        return nothing
    crowded = _ball_holds(points, faces[kept], points[opposite[kept]], emptiness)
    triangles, which = np.unique(np.sort(faces[kept], axis=1), axis=0, return_inverse=True)
    empty = np.ones(len(triangles), dtype=bool)
    empty[which.ravel()[crowded]] = False
    return triangles[empty].astype(np.int64)


def rim_points(
    points: NDArray[np.float64], normals: NDArray[np.float64], link_m: float, min_gap_deg: float
) -> NDArray[np.bool_]:
    """(N,) mask of the points whose neighbours within `link_m` leave a sector of `min_gap_deg` of their tangent
    plane free (the angle criterion of Bendels, Schnabel and Klein 2006).
    """
    distances, index = cKDTree(points).query(points, k=min(RIM_NEIGHBORS, len(points)), workers=thread_count())
    steps = points[index[:, 1:]] - points[:, None]
    helper = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angles = np.arctan2(np.einsum("nki,ni->nk", steps, second), np.einsum("nki,ni->nk", steps, first))
    # Points too far away repeat the nearest one's angle, which opens and closes no gap.
    angles = np.sort(np.where(distances[:, 1:] <= link_m, angles, angles[:, :1]), axis=1)
    around = np.concatenate([angles, angles[:, :1] + 2 * np.pi], axis=1)
    return np.diff(around, axis=1).max(axis=1) >= np.deg2rad(min_gap_deg)


def _edge_lengths(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """(T, 3) metres: the edge opposite each corner."""
    ends = points[triangles[:, _EDGES]]
    return np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)


def _ball_holds(
    points: NDArray[np.float64], triangles: NDArray[np.int64], others: NDArray[np.float64], share: float
) -> NDArray[np.bool_]:
    """(T,) mask: the ball around a triangle's circumcentre, `share` of its circumradius, holds its other point."""
    squared = _edge_lengths(points, triangles) ** 2
    weights = squared * (squared.sum(axis=1, keepdims=True) - 2 * squared)
    corners = points[triangles]
    total = weights.sum(axis=1, keepdims=True)
    centers = np.einsum("nk,nki->ni", weights / np.where(total > 0, total, 1.0), corners)
    radii = np.linalg.norm(corners[:, 0] - centers, axis=1)
    return np.linalg.norm(others - centers, axis=1) < share * radii * (1 - 1e-9)
