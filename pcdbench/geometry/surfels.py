"""Surfels: each point a small disk, so that rays can be cast on a cloud and points can hide one another.

One mechanism serves both needs. A ray meets a disk where the ray says, so a simulated scan of a dense cloud never
returns the cloud's own points; and a point is hidden where the ray to it meets a disk well before it, which is
a z-buffer with splats, without pixels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.geometry.duplicates import repeats
from pcdbench.geometry.neighbors import median_spacing
from pcdbench.geometry.visibility import MeshRaycaster
from pcdbench.threads import thread_count

NEIGHBORS = 10
FEWEST_POINTS = 4
_ANGLES = np.arange(6) * (np.pi / 3)
_FAN = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])


def surfel_mesh(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (6D, 3) and triangles (4D, 3) of one hexagon for each distinct point, tangent to the local surface.

    The normal is the direction of least spread of the nearest points; the radius is the
    distance to the third nearest point, at most three times the cloud's median of it, so that sparse regions stay
    closed and holes stay open.

    Args:
        points: (N, 3) metres; fewer than four have no surface, and no triangles.
    """
    if len(points):
        # Copies of a point would be its nearest, and leave it a disk of no size.
        points = points[~repeats(points)]
    if len(points) < FEWEST_POINTS:
        return np.empty((0, 3)), np.empty((0, 3), np.int64)
    center = points.mean(axis=0)
    tree = cKDTree(points - center)
    count = min(NEIGHBORS, len(points))
    distances, index = tree.query(points - center, k=count, workers=thread_count())
    spread = (points - center)[index]
    spread = spread - spread.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
    third = distances[:, min(3, count - 1)]
    radius = np.minimum(third, 3 * np.median(third))
    corners = (
        np.cos(_ANGLES)[None, :, None] * axes[:, None, :, 2] + np.sin(_ANGLES)[None, :, None] * axes[:, None, :, 1]
    )
    vertices = points[:, None] + radius[:, None, None] * corners
    triangles = (6 * np.arange(len(points)))[:, None, None] + _FAN
    return vertices.reshape(-1, 3), triangles.reshape(-1, 3)


class SurfelCloud:
    """A cloud that rays can be cast on and that hides its own points.

    Attributes:
        points: (N, 3) metres.
        tolerance_m: how far in front of a point a disk has to be to hide it: two median spacings.
        raycaster: rays cast on the disks.
    """

    def __init__(self, points: NDArray[np.float64]) -> None:
        """Build the disks of (N, 3) points."""
        self.points = points
        self.tolerance_m = 2 * median_spacing(points)
        self.raycaster = MeshRaycaster(*surfel_mesh(points))

    def visible(self, origin: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.int64]:
        """Those of the points at `index` that no disk hides from `origin` (3,)."""
        return index[~occluded(self.raycaster, origin, self.points[index], self.tolerance_m)]


def occluded(
    raycaster: MeshRaycaster, origin: NDArray[np.float64], points: NDArray[np.float64], tolerance_m: float
) -> NDArray[np.bool_]:
    """(N,) mask of the points that a surface more than `tolerance_m` in front of them hides from `origin`."""
    rays = points - origin
    range_m = np.linalg.norm(rays, axis=1)
    directions = rays / np.maximum(range_m, 1e-9)[:, None]
    hits = raycaster.cast(np.broadcast_to(origin, rays.shape), directions)
    return hits.range_m < range_m - tolerance_m
