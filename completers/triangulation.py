"""The triangles that span the holes of a cloud's mesh of near neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError, cKDTree

from pcdbench.threads import thread_count

RIM_NEIGHBORS = 24
JITTER = 1e-4
PLANE_NEIGHBORS = 16
PLANE_SINE = 0.3
MIN_SHARE_IN_PLANE = 0.5
SMOOTH_COSINE = 0.7
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
    max_open: float,
    rng: np.random.Generator,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """(T, 3) rows of `points`, Delaunay triangles that close holes, and (T, 3, 3) surface normals at their corners.

    A triangle is one where all corners are rim points, its longest edge is longer than `link_m` (it is no part
    of the mesh of near neighbours) but not than `max_edge_m`, the ball around it is empty (a Gabriel triangle, as
    surface reconstruction takes them), and the surface goes on in its plane at all three corners: there the normal
    is the triangle's, or half of the neighbours lie in its plane, as where two walls meet and no normal is right
    (there the triangle's own normal is returned). Of these, triangles that join smoothly make a lid, and
    a lid counts if the rim of its hole is around it.

    Args:
        points: (N, 3) metres, near the origin, N at least 4.
        normals: (N, 3) unit normals, of either sign.
        link_m: the longest edge of the mesh of near neighbours.
        min_gap_deg: see `rim_points`.
        min_cosine: of the angle between a triangle's normal and a corner's that counts as the same.
        emptiness: share of the radius of the triangle's smallest circumscribed ball that must be empty.
        max_open: largest share of a lid's border, by length, that may be other than the mesh and other lids.
        rng: moves points a little, so that gridded and planar clouds have a triangulation.
    """
    rim = rim_points(points, normals, link_m, min_gap_deg)
    try:
        tetrahedra = Delaunay(points + rng.uniform(-1, 1, points.shape) * JITTER * link_m).simplices
    except QhullError:
        return np.empty((0, 3), np.int64), np.empty((0, 3, 3))
    faces = tetrahedra[:, _FACES].reshape(-1, 3)
    opposite = tetrahedra.ravel()
    kept = np.flatnonzero(rim[faces].all(axis=1))
    edges = _edge_lengths(points, faces[kept])
    kept = kept[(edges.max(axis=1) > link_m) & (edges.max(axis=1) <= max_edge_m)]
    crowded = _ball_holds(points, faces[kept], points[opposite[kept]], emptiness)
    triangles, which = np.unique(np.sort(faces[kept], axis=1), axis=0, return_inverse=True)
    empty = np.ones(len(triangles), dtype=bool)
    empty[which.ravel()[crowded]] = False
    triangles = triangles[empty].astype(np.int64)

    flat = _triangle_normals(points, triangles)
    smooth = np.abs(np.einsum("nki,ni->nk", normals[triangles], flat)) >= min_cosine
    goes_on = (smooth | (_shares_in_plane(points, triangles, flat) >= MIN_SHARE_IN_PLANE)).all(axis=1)
    triangles, flat, smooth = triangles[goes_on], flat[goes_on], smooth[goes_on]
    if not len(triangles):
        return triangles, np.empty((0, 3, 3))
    enclosed = _open_shares(points, triangles, flat, link_m) <= max_open
    corner_normals = np.where(smooth[..., None], normals[triangles], flat[:, None])
    return triangles[enclosed], corner_normals[enclosed]


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


def _triangle_normals(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """(T, 3) unit normals of the triangles; zero where the corners are in line."""
    corners = points[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    return cross / np.where(length > 0, length, 1.0)


def _shares_in_plane(
    points: NDArray[np.float64], triangles: NDArray[np.int64], flat: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(T, 3) share of each corner's neighbours that lie in the triangle's plane, whose normal is in `flat` (T, 3)."""
    corners, place = np.unique(triangles, return_inverse=True)
    k = min(PLANE_NEIGHBORS + 1, len(points))
    _, index = cKDTree(points).query(points[corners], k=k, workers=thread_count())
    steps = points[index[:, 1:]] - points[corners, None]
    steps /= np.maximum(np.linalg.norm(steps, axis=2, keepdims=True), np.finfo(float).tiny)
    place = place.reshape(triangles.shape)
    shares = [(np.abs(np.einsum("nki,ni->nk", steps[at], flat)) <= PLANE_SINE).mean(axis=1) for at in place.T]
    # A triangle of no area is in no plane.
    return np.stack(shares, axis=1) * flat.any(axis=1, keepdims=True)


def _open_shares(
    points: NDArray[np.float64], triangles: NDArray[np.int64], flat: NDArray[np.float64], link_m: float
) -> NDArray[np.float64]:
    """(T,) share of the border of each triangle's lid that is open, by length.

    A lid is what triangles make that join smoothly at long edges. Its border with the rim are its short edges,
    which are of the mesh of near neighbours; its open border are the long edges that no second triangle has.
    """
    owner = np.tile(np.arange(len(triangles)), 3)
    ends = np.sort(np.concatenate([triangles[:, pair] for pair in _EDGES]), axis=1)
    edges, which, uses = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    lengths = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
    long = lengths > link_m
    order = np.argsort(which, kind="stable")
    edge, triangle = which[order], owner[order]
    # Most edges have two triangles and few have three: each is paired with the next ones at its edge.
    pairs = [
        np.column_stack([triangle[:-ahead], triangle[ahead:]])[(edge[:-ahead] == edge[ahead:]) & long[edge[ahead:]]]
        for ahead in (1, 2)
    ]
    one, other = np.concatenate(pairs).T
    smooth = np.abs(np.einsum("ni,ni->n", flat[one], flat[other])) >= SMOOTH_COSINE
    one, other = one[smooth], other[smooth]
    joined = coo_array((np.ones(len(one)), (one, other)), shape=(len(triangles), len(triangles)))
    _, lid = connected_components(joined, directed=False)
    open_m = np.bincount(lid[owner], weights=(lengths * (long & (uses == 1)))[which])
    rim_m = np.bincount(lid[owner], weights=(lengths * ~long)[which])
    border_m = open_m + rim_m
    return (open_m / np.where(border_m > 0, border_m, 1.0))[lid]


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
