"""Simulated scanning of a scene: what a sensor measures from a pose, and where it can be held.

The scene's mesh is scanned where it has one, else its dense cloud as surfels. What lies outside the bounds of the
complete cloud is never measured: a completed cloud knows nothing else.
"""

from __future__ import annotations

from typing import Annotated
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pcdbench.geometry.freespace import ANKLE_M, HEAD_M, FreeSpace, floor_height, free_space, points_on_triangles
from pcdbench.geometry.poses import Pose, inverse, transform
from pcdbench.geometry.surfels import SurfelCloud
from pcdbench.geometry.visibility import MeshRaycaster
from pcdbench.scene import Scene, Surface

MOST_SURFELS = 150_000
SENSOR_HEIGHT_M = 1.4
BOUNDS_MARGIN_M = 0.05
MAP_REACH_M = 1000.0

FieldOfView = tuple[Annotated[float, Field(gt=0, le=360)], Annotated[float, Field(gt=0, le=180)]]
"""Degrees, horizontal and vertical, as options have it: 360 by 180 is a sphere."""


class ScannedScene:
    """A scene as sensors meet it.

    Attributes:
        raycaster: of its mesh, or of the surfels of its dense cloud.
        free: where one can stand.
        sensor_height_m: 1.4 m above the floor, or lower where the scene ends below 1.8 m.
        lower, upper: (3,) metres, bounds of the complete cloud with a margin of 5 cm.
        tolerance_m: how far a complete point may lie behind the surface and still be on it.
    """

    def __init__(self, scene: Scene) -> None:
        complete = scene.complete.points
        self.lower, self.upper = complete.min(axis=0) - BOUNDS_MARGIN_M, complete.max(axis=0) + BOUNDS_MARGIN_M
        self.raycaster: MeshRaycaster
        if scene.surface is not None:
            self.raycaster = scene.surface.raycaster
            obstacles = _obstacles(scene.surface, self.lower, self.upper, floor_height(scene.dense.points))
            self.tolerance_m = BOUNDS_MARGIN_M
        else:
            obstacles = scene.dense.points
            surfels = SurfelCloud(obstacles[:: -(-len(obstacles) // MOST_SURFELS)])
            self.raycaster, self.tolerance_m = surfels.raycaster, max(surfels.tolerance_m, BOUNDS_MARGIN_M)
        self.free: FreeSpace = free_space(obstacles, scene.dense.points)
        self.sensor_height_m = self.free.floor_m + min(SENSOR_HEIGHT_M, 0.78 * float(self.upper[2] - self.free.floor_m))

    @property
    def center(self) -> NDArray[np.float64]:
        """(3,) the free position nearest to the centre of the bounds, at sensor height."""
        return self.at(self.free.nearest((self.lower[:2] + self.upper[:2]) / 2))

    def at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 3) the positions (..., 2) at sensor height."""
        return np.concatenate([xy, np.full((*xy.shape[:-1], 1), self.sensor_height_m)], axis=-1)

    def scan(
        self,
        T_scene_sensor: Pose,
        directions: NDArray[np.float64],
        max_range_m: float,
        noise_m: float,
        rng: np.random.Generator,
    ) -> NDArray[np.float64]:
        """(M, 3) what the sensor measures, in its own frame; as many random numbers are drawn as there are rays.

        Args:
            directions: (R, 3) unit vectors in the sensor's frame.
            noise_m: standard deviation of a range.
        """
        points = cast_scan(self.raycaster, T_scene_sensor, directions, max_range_m, noise_m, rng)
        return points[self.holds(transform(T_scene_sensor, points))]

    def holds(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) mask of the (N, 3) points within the bounds."""
        return ((points >= self.lower) & (points <= self.upper)).all(axis=1)

    def map_of(self, points: NDArray[np.float64]) -> SurfelCloud:
        """The disks of a completed cloud (N, 3): those within 1 km of the bounds, which is farther than scans go.

        Embree's float32 spans all that it is given: one stray at 10^7 m would blur all else to a metre.
        """
        away = np.maximum(self.lower - points, points - self.upper).max(axis=1)
        return SurfelCloud(points[away <= MAP_REACH_M])

    def firmness(
        self, T_scene_sensor: Pose, directions: NDArray[np.float64], max_range_m: float
    ) -> NDArray[np.float64]:
        """(N,) how firmly scans from N poses (N, 4, 4) pin them: 0 where a pose could slide and nobody would see.

        The smallest eigenvalue of the mean of n n^T over all rays, with n the normal of the surface that a ray
        meets within range and bounds, and 0 where it meets none: the stiffness of point-to-plane registration in
        its weakest direction (Gelfand et al. 2003), translations alone.

        Args:
            directions: (R, 3) unit vectors in the sensor's frame.
        """
        rays = np.einsum("nij,rj->nri", T_scene_sensor[:, :3, :3], directions)
        origins = np.repeat(T_scene_sensor[:, :3, 3], len(directions), axis=0)
        hits = self.raycaster.cast(origins, rays.reshape(-1, 3))
        met = hits.range_m <= max_range_m
        points = origins + np.where(met, hits.range_m, 0.0)[:, None] * rays.reshape(-1, 3)
        met &= self.holds(points)
        normals = np.where(met[:, None], hits.normals, 0.0).reshape(*rays.shape)
        return np.linalg.eigvalsh(np.einsum("nri,nrj->nij", normals, normals) / len(directions))[:, 0]


def _obstacles(
    surface: Surface, lower: NDArray[np.float64], upper: NDArray[np.float64], floor_m: float
) -> NDArray[np.float64]:
    """(N, 3) points on what stands in the way within the bounds, glass too: the rest of the mesh costs nothing."""
    corners = surface.vertices[surface.triangles]
    least, most = corners.min(axis=1), corners.max(axis=1)
    inside = (most[:, :2] >= lower[:2]).all(axis=1) & (least[:, :2] <= upper[:2]).all(axis=1)
    in_the_way = (most[:, 2] > floor_m + ANKLE_M) & (least[:, 2] < floor_m + HEAD_M)
    return points_on_triangles(corners[inside & in_the_way])


_scanned: WeakKeyDictionary[Scene, ScannedScene] = WeakKeyDictionary()


def scanned(scene: Scene) -> ScannedScene:
    """The `ScannedScene` of a scene, made once for as long as the scene lives.

    Raises:
        Skipped: where there is nowhere to stand in it.
    """
    if scene not in _scanned:
        _scanned[scene] = ScannedScene(scene)
    return _scanned[scene]


def cast_scan(
    raycaster: MeshRaycaster,
    T_scene_sensor: Pose,
    directions: NDArray[np.float64],
    max_range_m: float,
    noise_m: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """(M, 3) points measured along the (R, 3) directions within `max_range_m`, with noise, in the sensor's frame."""
    rays = directions @ T_scene_sensor[:3, :3].T
    hits = raycaster.cast(T_scene_sensor[:3, 3], rays)
    noise = rng.normal(0.0, noise_m, len(directions))
    hit = hits.range_m <= max_range_m
    return directions[hit] * (hits.range_m + noise)[hit, None]


def within_view(
    points: NDArray[np.float64],
    T_scene_sensor: Pose,
    max_range_m: float,
    horizontal_fov_deg: float = 360.0,
    vertical_fov_deg: float = 180.0,
) -> NDArray[np.int64]:
    """Index of the (N, 3) points within range and field of view of a sensor, hidden or not.

    The field is one of angles, azimuth and elevation each to half its width, so that 360 by 180 degrees is a sphere.
    """
    local = transform(inverse(T_scene_sensor), points)
    flat = np.hypot(local[:, 0], local[:, 1])
    seen = np.einsum("ij,ij->i", local, local) <= max_range_m**2
    if horizontal_fov_deg < 360.0:
        seen &= np.abs(np.arctan2(local[:, 1], local[:, 0])) <= np.radians(horizontal_fov_deg / 2)
    if vertical_fov_deg < 180.0:
        seen &= np.abs(local[:, 2]) <= np.tan(np.radians(vertical_fov_deg / 2)) * flat
    return np.flatnonzero(seen)


def shown(
    cloud: SurfelCloud,
    T_scene_sensor: Pose,
    max_range_m: float,
    horizontal_fov_deg: float = 360.0,
    vertical_fov_deg: float = 180.0,
) -> NDArray[np.float64]:
    """(M, 3) the points of a cloud that are seen from a pose: in range, in view and not hidden; in its own frame."""
    index = within_view(cloud.points, T_scene_sensor, max_range_m, horizontal_fov_deg, vertical_fov_deg)
    seen = cloud.visible(T_scene_sensor[:3, 3], index)
    return transform(inverse(T_scene_sensor), cloud.points[seen])


def random_directions(
    count: int, horizontal_fov_deg: float, vertical_fov_deg: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """(count, 3) unit vectors, evenly random over a field of azimuth and elevation; sensor frame."""
    azimuth = rng.uniform(-0.5, 0.5, count) * np.radians(horizontal_fov_deg)
    limit = np.sin(np.radians(vertical_fov_deg / 2))
    z = rng.uniform(-limit, limit, count)
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), z], axis=1)
