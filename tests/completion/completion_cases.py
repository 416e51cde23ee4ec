"""Halls of known shape with holes cut into them, and completers as third parties write them."""

from __future__ import annotations

import numpy as np

from pcdbench import Completer, PointCloud
from pcdbench.geometry.sampling import poisson_disk_indices


def hall(
    spacing_m: float = 0.08, size=(12.0, 9.0), color: bool = True, seed: int = 0, even: bool = False
) -> PointCloud:
    """A floor and two walls, each point drawn on its own (or evenly spaced): red floor, blue walls."""
    rng = np.random.default_rng(seed)
    x, y = size
    faces = [((x, y, 0), [0.8, 0.2, 0.2]), ((x, 0, 2.5), [0.2, 0.2, 0.8]), ((0, y, 2.5), [0.2, 0.2, 0.8])]
    points, colors = [], []
    for sides, color_of_face in faces:
        count = round(float(np.prod([side for side in sides if side])) / spacing_m**2)
        drawn = rng.random((count * (5 if even else 1), 3)) * sides
        points.append(drawn[poisson_disk_indices(drawn, count, rng)] if even else drawn)
        colors.append(np.tile(np.float32(color_of_face), (count, 1)))
    return PointCloud(np.concatenate(points), np.concatenate(colors) if color else None)


def without(cloud: PointCloud, center, radius_m: float) -> PointCloud:
    """The cloud without what lies in a ball."""
    return cloud.select(np.linalg.norm(cloud.points - np.array(center), axis=1) > radius_m)


class Floor(Completer):
    """Makes the whole cloud anew, as networks do: what it was given, moved a little, and a grid on the floor."""

    def __init__(self, spacing_m: float = 0.05, color: bool = True) -> None:
        super().__init__()
        self.spacing_m, self.color = spacing_m, color

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
        x, y = (np.arange(a, b, self.spacing_m) for a, b in zip(low[:2], high[:2], strict=True))
        grid = np.stack(np.meshgrid(x, y, [low[2]]), axis=-1).reshape(-1, 3)
        moved = cloud.points + rng.normal(0, 0.01, cloud.points.shape)
        points = np.concatenate([moved, grid + rng.normal(0, 0.004, grid.shape)])
        points = points[rng.permutation(len(points))]
        return PointCloud(points, np.full(points.shape, 0.5) if self.color and cloud.colors is not None else None)


class Nothing(Completer):
    """Adds nothing."""

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        return cloud
