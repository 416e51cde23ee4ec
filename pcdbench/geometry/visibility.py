"""What is seen from where: rays cast on a triangle mesh, and the directions that cameras and scanners look in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcdbench.open3d_loader import load_open3d
from pcdbench.threads import thread_count

SLACK = 1e-4  # of a range: how far Embree's float32 may be off


@dataclass(frozen=True, eq=False)
class Hits:
    """What each of R rays met first.

    Attributes:
        range_m: (R,) float64 distance along the ray, `inf` where it met nothing.
        triangle: (R,) int64 row of the mesh's triangles, -1 where it met nothing.
        normals: (R, 3) float64 unit normal of that triangle, turned towards the ray's origin; 0 where nothing.
    """

    range_m: NDArray[np.float64]
    triangle: NDArray[np.int64]
    normals: NDArray[np.float64]


class MeshRaycaster:
    """A triangle mesh prepared for casting rays (Open3D's RaycastingScene, Embree).

    Embree finds the triangle in float32; coordinates are centred on the mesh first, so that a room at map coordinates
    of 10^6 m is cast as exactly as one at the origin. How far away it is is computed from its plane in float64:
    Embree's own distances rest on the processor's approximate reciprocal and end otherwise on each make of processor.
    """

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike) -> None:
        """Prepare a mesh.

        Args:
            vertices: (V, 3) metres.
            triangles: (T, 3) rows of `vertices`; both sides of a triangle stop rays. T may be 0.
        """
        open3d = load_open3d()
        corners = np.asarray(vertices, np.float64).reshape(-1, 3)
        faces = np.asarray(triangles, np.int64).reshape(-1, 3)
        self._center = (corners.min(axis=0) + corners.max(axis=0)) / 2 if len(corners) else np.zeros(3)
        self._empty = len(faces) == 0
        self._normals, self._offsets = _planes(*np.moveaxis((corners - self._center)[faces], 1, 0))
        self._scene = open3d.t.geometry.RaycastingScene(nthreads=thread_count())
        if not self._empty:
            self._scene.add_triangles(
                open3d.core.Tensor(np.ascontiguousarray(corners - self._center, np.float32)),
                open3d.core.Tensor(np.ascontiguousarray(faces, np.uint32)),
            )

    def cast(self, origins: ArrayLike, directions: ArrayLike) -> Hits:
        """The first hit of each ray.

        Args:
            origins: (R, 3) metres, in the mesh's frame, or (3,) where all rays share one.
            directions: (R, 3) unit vectors.
        """
        towards = np.asarray(directions, np.float64).reshape(-1, 3)
        if self._empty or not len(towards):
            count = len(towards)
            return Hits(np.full(count, np.inf), np.full(count, -1, np.int64), np.zeros((count, 3)))
        rays = np.empty((len(towards), 6), np.float32)
        rays[:, :3] = np.asarray(origins, np.float64) - self._center
        rays[:, 3:] = towards
        answer = self._scene.cast_rays(load_open3d().core.Tensor(rays), nthreads=thread_count())
        range_m = answer["t_hit"].numpy().astype(np.float64)
        hit = np.flatnonzero(np.isfinite(range_m))
        found = answer["primitive_ids"].numpy()[hit].astype(np.int64)
        triangle = np.full(len(towards), -1, np.int64)
        triangle[hit] = found
        facing = self._normals[found]
        start = np.broadcast_to(np.asarray(origins, np.float64) - self._center, towards.shape)[hit]
        against, ahead = row_products(facing, towards[hit]), self._offsets[found] - row_products(facing, start)
        slack = SLACK * (1.0 + range_m[hit])
        # A ray in the triangle's plane, nearly, meets it anywhere: there what was found may be bettered a little only.
        exact = np.divide(ahead, against, out=range_m[hit], where=against != 0)
        range_m[hit] = np.clip(exact, np.maximum(range_m[hit] - slack, 0.0), range_m[hit] + slack)
        normals = np.zeros(towards.shape)
        normals[hit] = facing * np.where(against > 0, -1.0, 1.0)[:, None]
        return Hits(range_m, triangle, normals)


def _planes(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """The planes through the corners (T, 3) of triangles: unit normals n (T, 3), 0 without area, and n . a (T,)."""
    normals = np.cross(b - a, c - a)
    length = np.sqrt(row_products(normals, normals))
    normals /= np.where(length > 0, length, 1.0)[:, None]
    return normals, row_products(normals, a)


def row_products(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) dot products of the rows of two (N, 3) arrays, summed in this order on every processor."""
    return left[:, 0] * right[:, 0] + left[:, 1] * right[:, 1] + left[:, 2] * right[:, 2]


def camera_directions(horizontal_fov_deg: float, width: int, height: int) -> NDArray[np.float64]:
    """(H*W, 3) unit directions through the centres of a pinhole camera's square pixels, row by row from the top.

    Camera frame: x forward, y left, z up; the optical axis is the middle of the image.

    Args:
        horizontal_fov_deg: angle between the image's left and right border, in (0, 180).

    Raises:
        ValueError: for any other angle.
    """
    if not 0.0 < horizontal_fov_deg < 180.0:
        raise ValueError(f"horizontal_fov_deg must lie in (0, 180), not {horizontal_fov_deg}")
    pixel = 2.0 * np.tan(np.radians(horizontal_fov_deg) / 2) / width
    left = ((width - 1) / 2 - np.arange(width)) * pixel
    up = ((height - 1) / 2 - np.arange(height)) * pixel
    rays = np.ones((height, width, 3))
    rays[..., 1], rays[..., 2] = left[None, :], up[:, None]
    return (rays / np.linalg.norm(rays, axis=2, keepdims=True)).reshape(-1, 3)


def panorama_directions(
    step_deg: float, min_elevation_deg: float = -60.0, max_elevation_deg: float = 90.0
) -> NDArray[np.float64]:
    """(R, 3) unit directions of a scanner on a tripod: full turns in azimuth at each elevation, z up.

    Like a terrestrial laser scanner, but with about the same angle between neighbours everywhere: rings near
    the zenith hold fewer rays.

    Args:
        step_deg: angle between neighbouring rays, along a ring and between rings.
    """
    rings = np.arange(min_elevation_deg + step_deg / 2, max_elevation_deg, step_deg)
    elevation = np.radians(rings)
    per_ring = np.maximum(1, np.rint(360.0 / step_deg * np.cos(elevation))).astype(np.int64)
    first = np.cumsum(per_ring) - per_ring
    within = np.arange(per_ring.sum()) - np.repeat(first, per_ring)
    azimuth = 2 * np.pi * (within + 0.5) / np.repeat(per_ring, per_ring)
    elevation = np.repeat(elevation, per_ring)
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=1)
