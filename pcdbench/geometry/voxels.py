"""Voxels: a regular grid of cubes in space, and the mean colour of the points in each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcdbench.geometry.neighbors import median_spacing

MAX_VOXELS_A_SIDE = 512
"""Images of more pixels a side than this cost much and show nothing that a scan of a room holds."""


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """A regular grid of cubes.

    Attributes:
        origin: (3,) metres: the low corner of voxel (0, 0, 0).
        edge_m: the edge of a voxel, metres.
        shape: the number of voxels along x, y and z.
    """

    origin: NDArray[np.float64]
    edge_m: float
    shape: tuple[int, int, int]

    @classmethod
    def covering(cls, low: NDArray[np.float64], high: NDArray[np.float64], edge_m: float) -> VoxelGrid:
        """The smallest grid of cubes of `edge_m` that covers the box from `low` to `high`, centred on it.

        Centring gives both ends of the box the same clearance (less than half a voxel), so that points on
        its faces lie inside voxels rather than on the borders between them.
        """
        low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        counts = np.floor((high - low) / edge_m).astype(np.int64) + 1
        origin = (low + high - counts * edge_m) / 2
        return cls(origin, float(edge_m), (int(counts[0]), int(counts[1]), int(counts[2])))

    def clamped_index(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """(N, 3) voxel of each of the (N, 3) points; a point outside belongs to the border voxel nearest to it."""
        index = np.floor((points - self.origin) / self.edge_m)
        return np.clip(index, 0, np.array(self.shape) - 1).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Voxels:
    """The voxels of a grid that hold points enough.

    Attributes:
        index: (V, 3) distinct voxels.
        colors: (V, 3) mean colour of the points in each.
        shape: the number of voxels of the grid along x, y and z.
    """

    index: NDArray[np.int64]
    colors: NDArray[np.float64]
    shape: tuple[int, int, int]


def voxelize(points: NDArray[np.float64], colors: NDArray[np.floating], grid: VoxelGrid, min_points: int = 1) -> Voxels:
    """The voxels that hold `min_points` or more of (N, 3) points, in metres, with the mean of their (N, 3) colours.

    Points outside the grid count in its border, so that they show instead of being forgotten: seen along the
    axis on which they lie outside they keep their place in front of everything further in.
    """
    flat = np.ravel_multi_index(tuple(grid.clamped_index(points).T), grid.shape)
    occupied, voxel_of_point, counts = np.unique(flat, return_inverse=True, return_counts=True)
    sums = [np.bincount(voxel_of_point, weights=channel, minlength=len(occupied)) for channel in colors.T]
    enough = counts >= min_points
    index = np.stack(np.unravel_index(occupied[enough], grid.shape), axis=1)
    return Voxels(index, np.stack(sums, axis=1)[enough] / counts[enough, None], grid.shape)


def edge_from_density(points: NDArray[np.float64], spacings: float) -> float:
    """A voxel edge in metres that suits the density of a cloud: `spacings` times its median spacing.

    Where points lie so close together that the longest side would have more than `MAX_VOXELS_A_SIDE` voxels,
    the edge grows to that; 0 where no two points are distinct.
    """
    longest_m = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    return max(spacings * median_spacing(points), longest_m / MAX_VOXELS_A_SIDE)
