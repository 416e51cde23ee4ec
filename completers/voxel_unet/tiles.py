"""The network over a grid of any size: overlapping tiles, each of them predicted alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.threads import thread_count

from .grid import Grid, network_input

if TYPE_CHECKING:
    from torch import Tensor, nn

HALO = 16  # voxels on each side of a tile that are read but not used
STEP = 64
TILE = STEP + 2 * HALO


@dataclass(frozen=True)
class Prediction:
    """Sub-voxels where the network finds unobserved surface.

    Attributes:
        points: (M, 3) metres.
        probability: (M,) of surface there, give or take a sub-voxel across it.
        colors: (M, 3) in [0, 1].
        axis: (M,) int8, the axis across the surface: 0, 1, 2 for x, y, z.
    """

    points: NDArray[np.float64]
    probability: NDArray[np.float32]
    colors: NDArray[np.float32]
    axis: NDArray[np.int8]

    def select(self, rows: NDArray) -> Prediction:
        """The prediction at these rows (or at this mask)."""
        return Prediction(*(values[rows] for values in vars(self).values()))


def predict(network: nn.Module, cloud: PointCloud, grid: Grid, threshold: float) -> Prediction:
    """Where in the grid the probability of surface passes the threshold, tile by tile: memory does not grow with it.

    Args:
        cloud: what was observed, metres; all of it lies in the grid.
    """
    import torch

    from .network import placed

    torch.set_num_threads(thread_count())
    blocks = _rows_by_block(cloud.points, grid)
    none = np.zeros((0, 3))
    found = [Prediction(none, np.zeros(0, np.float32), none.astype(np.float32), np.zeros(0, np.int8))]
    with torch.inference_mode():
        for tile in product(*(_spans(size) for size in grid.shape)):
            part = grid.part([span.read[0] for span in tile], [span.read[1] for span in tile])
            near = product(*(range(span.read[0] // STEP, (span.read[1] - 1) // STEP + 1) for span in tile))
            rows = np.concatenate([blocks.get(block, np.zeros(0, np.int64)) for block in near])
            seen = cloud.select(np.sort(rows[part.holds(cloud.points[rows])]))
            if not len(seen):
                continue
            out = network(torch.from_numpy(network_input(seen, part))[None])[0]
            inner = tuple(slice(2 * (span.used[0] - span.read[0]), 2 * (span.used[1] - span.read[0])) for span in tile)
            probability, ridge, axis = (part[inner] for part in surface(torch.sigmoid(out[0].float())))
            out = out[:, inner[0], inner[1], inner[2]]
            x, y, z = torch.nonzero(ridge & (probability > threshold), as_tuple=True)
            offsets, colors = placed(out[1:, x, y, z].T)
            corner = 2 * np.array([span.used[0] for span in tile])
            cells = torch.stack([x, y, z], dim=1).numpy() + corner + 0.5 + offsets.double().numpy()
            points = grid.origin + cells * (grid.edge_m / 2)
            found.append(Prediction(points, probability[x, y, z].numpy(), colors.numpy(), axis[x, y, z].numpy()))
    return Prediction(
        *(np.concatenate(values) for values in zip(*(vars(part).values() for part in found), strict=True))
    )


def surface(occupancy: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """How likely surface crosses each sub-voxel and its two neighbours, and whether it is likeliest just there.

    Where a surface is certain but not how deep it lies, its occupancy is spread over a few sub-voxels, none of which
    is likely by itself. So three in a row are taken together, across the surface: along the axis on which the two
    neighbours are least occupied (the less occupied counts twice), since along the surface they are as occupied as
    what lies between them. Of the three the likeliest is where the surface is put.

    Args:
        occupancy: (X, Y, Z) of the sub-voxels.

    Returns:
        (X, Y, Z) the probability that any of the three is occupied, as if they did not depend on each other; the
        (X, Y, Z) mask of the likeliest of their three; and the (X, Y, Z) int8 axis.
    """
    import torch

    least = torch.full_like(occupancy, torch.inf)
    others, ridge = torch.zeros_like(occupancy), torch.zeros_like(occupancy, dtype=torch.bool)
    across = torch.zeros_like(occupancy, dtype=torch.int8)
    for axis, (before, after) in enumerate(neighbors(occupancy)):
        beside = before + after + torch.minimum(before, after)
        less = beside < least
        least = torch.where(less, beside, least)
        others = torch.where(less, before + after - before * after, others)
        ridge = torch.where(less, occupancy >= torch.maximum(before, after), ridge)
        across = torch.where(less, axis, across)
    return occupancy + others - occupancy * others, ridge, across


def neighbors(occupancy: Tensor) -> Iterator[tuple[Tensor, Tensor]]:
    """Along x, y and z: what lies before and after each cell of an (X, Y, Z) grid, zero beyond its borders."""
    from torch.nn import functional as F

    padded = F.pad(occupancy, (1,) * 6)
    for axis in range(3):
        before, after = (
            padded[tuple(shifted if other == axis else slice(1, -1) for other in range(3))]
            for shifted in (slice(None, -2), slice(2, None))
        )
        yield before, after


def _rows_by_block(points: NDArray[np.float64], grid: Grid) -> dict[tuple[int, ...], NDArray[np.int64]]:
    """The rows of the points in each cube of STEP voxels, by its number along x, y, z."""
    block = np.floor((points - grid.origin) / (STEP * grid.edge_m)).astype(np.int64)
    order = np.lexsort(block.T)
    starts = np.flatnonzero(np.any(np.diff(block[order], axis=0, prepend=-1), axis=1))
    return {tuple(block[rows[0]].tolist()): rows for rows in np.split(order, starts[1:])}


@dataclass(frozen=True)
class _Span:
    """Of one tile along one axis, in voxels: what is read, and the part whose output is used."""

    read: tuple[int, int]
    used: tuple[int, int]


def _spans(size: int) -> list[_Span]:
    """The tiles along an axis; the used parts make up the whole, and all begin at multiples of the coarsest voxel."""
    if size <= TILE:
        return [_Span((0, size), (0, size))]
    spans = []
    for start in range(0, size - 2 * HALO, STEP):
        end = min(size, start + TILE)
        spans.append(_Span((start, end), (start + HALO if start else 0, end - HALO if end < size else size)))
    return spans
