"""Box rooms and spheres of known shape, holes cut into them, and the Chamfer distance by its definition."""

import numpy as np
from scipy.spatial import cKDTree

from pcdbench import PointCloud
from pcdbench.geometry.sampling import poisson_disk_indices

SIZE_M = np.array([6.0, 4.0, 2.7])


def box_room(count: int = 12_000, noise_m: float = 0.004) -> PointCloud:
    """The six faces of a room, spaced evenly (Poisson disk), red walls, green floor and ceiling."""
    random = random_box_room(4 * count, noise_m)
    return random.select(poisson_disk_indices(random.points, count, np.random.default_rng(8)))


def random_box_room(count: int = 12_000, noise_m: float = 0.004) -> PointCloud:
    """The same, every point drawn on its own: clumps and natural gaps."""
    rng = np.random.default_rng(7)
    x, y, z = SIZE_M
    areas = np.array([y * z, y * z, x * z, x * z, x * y, x * y])
    face = rng.choice(6, count, p=areas / areas.sum())
    points = rng.random((count, 3)) * SIZE_M
    axis = face // 2
    points[np.arange(count), axis] = (face % 2) * SIZE_M[axis]
    colors = np.where((axis == 2)[:, None], [0.1, 0.8, 0.1], [0.8, 0.1, 0.1])
    return PointCloud(points + rng.normal(0, noise_m, points.shape), colors.astype(np.float32))


def sphere(radius_m: float, count: int) -> PointCloud:
    """Points evenly on a sphere around the origin (a golden-angle spiral)."""
    z = 1 - 2 * (np.arange(count) + 0.5) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    return PointCloud(radius_m * np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z]))


def far_from(cloud: PointCloud, centers: list[list[float]], radius_m: float) -> PointCloud:
    """The cloud without balls around `centers`."""
    distances, _ = cKDTree(np.array(centers)).query(cloud.points)
    return cloud.select(distances > radius_m)


def chamfer(a: PointCloud, b: PointCloud) -> float:
    """Mean squared nearest distance both ways, summed, in square metres."""
    there, _ = cKDTree(b.points).query(a.points)
    back, _ = cKDTree(a.points).query(b.points)
    return float((there**2).mean() + (back**2).mean())
