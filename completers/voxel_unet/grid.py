"""From a cloud to the voxel grid the network reads, and where its sub-voxels lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud

from ..prism import Prism

CHANNELS = 13
NEAR, DEEP = -4.0, 12.0  # voxels: how far outside and inside of the prism depths are told apart


@dataclass(frozen=True)
class Grid:
    """A regular grid of voxels, each of 2 x 2 x 2 sub-voxels.

    Attributes:
        origin: (3,) metres: the low corner of voxel (0, 0, 0).
        edge_m: the edge of a voxel; sub-voxels have half of it.
        shape: voxels along x, y, z.
        floor_m: z of the lowest corner of the whole grid that this one may be a part of.
        prism: what stands around the points of the whole grid.
    """

    origin: NDArray[np.float64]
    edge_m: float
    shape: tuple[int, int, int]
    floor_m: float
    prism: Prism

    @staticmethod
    def around(points: NDArray[np.float64], edge_m: float, shift: NDArray[np.float64] | None = None) -> Grid:
        """The smallest grid with a margin of two voxels around the points; `shift` in [0, 1) moves its corner."""
        origin = points.min(axis=0) - (2.0 + (np.zeros(3) if shift is None else shift)) * edge_m
        x, y, z = (int(n) for n in np.ceil((points.max(axis=0) - origin) / edge_m + 2.0))
        return Grid(origin, edge_m, (x, y, z), float(origin[2]), Prism.around(points, 2 * edge_m))

    def part(self, start: Sequence[int] | NDArray, stop: Sequence[int] | NDArray) -> Grid:
        """The voxels from `start` up to `stop` (three numbers each)."""
        x, y, z = (int(last) - int(first) for first, last in zip(start, stop, strict=True))
        return Grid(self.origin + np.asarray(start) * self.edge_m, self.edge_m, (x, y, z), self.floor_m, self.prism)

    def cells(self, points: NDArray[np.float64], per_edge: int = 1) -> tuple[NDArray, NDArray]:
        """Flat index (N,) of each point's cell and its offset (N, 3) from the cell's centre in cells, [-0.5, 0.5].

        Args:
            per_edge: 1 for voxels, 2 for sub-voxels.
        """
        scaled = (points - self.origin) * (per_edge / self.edge_m)
        shape = np.array(self.shape) * per_edge
        index = np.clip(np.floor(scaled).astype(np.int64), 0, shape - 1)
        return (index[:, 0] * shape[1] + index[:, 1]) * shape[2] + index[:, 2], scaled - index - 0.5

    def holds(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) mask of the points inside the grid."""
        scaled = (points - self.origin) / self.edge_m
        return np.all((scaled >= 0) & (scaled < self.shape), axis=1)


def network_input(cloud: PointCloud, grid: Grid) -> NDArray[np.float32]:
    """(13, X, Y, Z): observed, log count, mean offset (3), mean colour (3), has colour, height above the floor,
    depth inside the prism (3): from its sides, its top and its bottom.

    Where nothing was observed all but height and depths is zero. Colours are centred at zero.
    """
    total = int(np.prod(grid.shape))
    cell, offset = grid.cells(cloud.points)
    count = np.bincount(cell, minlength=total)
    seen = np.flatnonzero(count)
    features = np.zeros((CHANNELS, total), dtype=np.float32)
    features[0, seen] = 1.0
    features[1, seen] = np.log(count[seen]) / 2
    for axis in range(3):
        features[2 + axis, seen] = np.bincount(cell, offset[:, axis], minlength=total)[seen] / count[seen]
    if cloud.colors is not None:
        for channel in range(3):
            mean = np.bincount(cell, cloud.colors[:, channel], minlength=total)[seen] / count[seen]
            features[5 + channel, seen] = 2 * mean - 1
        features[8] = 1.0
    height_m = grid.origin[2] - grid.floor_m + np.arange(grid.shape[2]) * grid.edge_m
    voxels = features.reshape(CHANNELS, *grid.shape)
    voxels[9] = height_m / 3.0
    x, y, z = (low + (np.arange(n) + 0.5) * grid.edge_m for low, n in zip(grid.origin, grid.shape, strict=True))
    plan = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    sides = grid.prism.side_depth(plan).reshape(*grid.shape[:2], 1)
    for channel, depth_m in ((10, sides), (11, grid.prism.high - z), (12, z - grid.prism.low)):
        voxels[channel] = np.clip(depth_m / grid.edge_m, NEAR, DEEP) / 8
    return voxels


def sub_voxel_means(
    cloud: PointCloud, grid: Grid
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32] | None]:
    """Occupied sub-voxels: flat index (M,), mean offset (M, 3) in sub-voxels, mean colour (M, 3) or None."""
    total = 8 * int(np.prod(grid.shape))
    cell, offset = grid.cells(cloud.points, per_edge=2)
    count = np.bincount(cell, minlength=total)
    occupied = np.flatnonzero(count)
    means = [np.bincount(cell, offset[:, axis], minlength=total)[occupied] / count[occupied] for axis in range(3)]
    offsets = np.stack(means, axis=1).astype(np.float32)
    if cloud.colors is None:
        return occupied, offsets, None
    tints = [np.bincount(cell, cloud.colors[:, c], minlength=total)[occupied] / count[occupied] for c in range(3)]
    return occupied, offsets, np.stack(tints, axis=1).astype(np.float32)
