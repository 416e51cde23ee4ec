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
    from torch import Tensor

    from .network import VoxelUNet

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


def predict(
    network: VoxelUNet, cloud: PointCloud, grid: Grid, threshold: float, beyond_m: float = np.inf
) -> Prediction:
    """Where in the grid the probability of surface passes the threshold, tile by tile: memory does not grow with it.

    Args:
        cloud: what was observed, metres; all of it lies in the grid.
        beyond_m: nobody asks farther outside of the prism than this: tiles that lie there are not read.
    """
    import torch

    torch.set_num_threads(thread_count())
    blocks = _rows_by_block(cloud.points, grid)
    none = np.zeros((0, 3))
    found = [Prediction(none, np.zeros(0, np.float32), none.astype(np.float32), np.zeros(0, np.int8))]
    with torch.inference_mode():
        for tile in _tiles_with_points(blocks, grid):
            # With a voxel around it, as offsets move points.
            low, high = (
                grid.origin + grid.edge_m * np.array(ends) for ends in zip(*(span.around for span in tile), strict=True)
            )
            if grid.prism.misses(low, high, beyond_m):
                continue
            part = grid.part([span.read[0] for span in tile], [span.read[1] for span in tile])
            near = product(*(range(span.read[0] // STEP, (span.read[1] - 1) // STEP + 1) for span in tile))
            rows = np.concatenate([blocks.get(block, np.zeros(0, np.int64)) for block in near])
            seen = cloud.select(np.sort(rows[part.holds(cloud.points[rows])]))
            if not len(seen):
                continue
            trunk = network.trunk(torch.from_numpy(network_input(seen, part))[None])
            occupancy = torch.sigmoid(network.occupancy(trunk))
            at = torch.nonzero(_may_be_surface(occupancy, threshold, part.cells(seen.points, per_edge=2)[0], tile))
            probability, ridge, axis = surface(occupancy, at)
            likely = ridge & (probability > threshold)
            at = at[likely]
            offsets, colors = network.details(trunk, at)
            first = np.array([2 * span.read[0] for span in tile])
            points = grid.origin + (at.numpy() + first + 0.5 + offsets.double().numpy()) * (grid.edge_m / 2)
            found.append(Prediction(points, probability[likely].numpy(), colors.numpy(), axis[likely].numpy()))
    return Prediction(
        *(np.concatenate(values) for values in zip(*(vars(part).values() for part in found), strict=True))
    )


def _tiles_with_points(blocks: dict[tuple[int, ...], NDArray[np.int64]], grid: Grid) -> Iterator[tuple[_Span, ...]]:
    """The tiles that read a block with points, in order: one stray far off must not cost all the space between."""
    counts = [_span_count(size) for size in grid.shape]
    numbers = {
        number
        for block in blocks
        for number in product(
            *(range(max(at - 1, 0), min(at, count - 1) + 1) for at, count in zip(block, counts, strict=True))
        )
    }
    for number in sorted(numbers):
        yield tuple(_span(size, at) for size, at in zip(grid.shape, number, strict=True))


def _may_be_surface(
    occupancy: Tensor, threshold: float, observed: NDArray[np.int64], tile: tuple[_Span, ...]
) -> Tensor:
    """(X, Y, Z) mask of a tile's sub-voxels that are asked: not its halo, nor what was observed or is too unlikely."""
    import torch

    used = tuple(slice(2 * (span.used[0] - span.read[0]), 2 * (span.used[1] - span.read[0])) for span in tile)
    asked = torch.zeros(occupancy.shape, dtype=torch.bool)
    # The likeliest of three that pass the threshold together is at least so likely.
    asked[used] = occupancy[used] > 1 - (1 - threshold) ** (1 / 3)
    asked.view(-1)[torch.from_numpy(observed)] = False
    return asked


def surface(occupancy: Tensor, at: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """How likely surface crosses a sub-voxel and its two neighbours, and whether it is likeliest just there.

    Where a surface is certain but not how deep it lies, its occupancy is spread over a few sub-voxels, none of which
    is likely by itself. So three in a row are taken together, across the surface: along the axis on which the two
    neighbours are least occupied (the less occupied counts twice), since along the surface they are as occupied as
    what lies between them. Of the three the likeliest is where the surface is put.

    Args:
        occupancy: (X, Y, Z) of the sub-voxels.
        at: (M, 3) int64, those to ask.

    Returns:
        (M,) the probability that any of the three is occupied, as if they did not depend on each other; the (M,) mask
        of the likeliest of their three; and the (M,) int8 axis.
    """
    import torch

    here, *rows = around(occupancy, at)
    least = torch.full_like(here, torch.inf)
    others, ridge = torch.zeros_like(here), torch.zeros_like(here, dtype=torch.bool)
    across = torch.zeros_like(here, dtype=torch.int8)
    for axis, (before, after) in enumerate(rows):
        beside = before + after + torch.minimum(before, after)
        less = beside < least
        least = torch.where(less, beside, least)
        others = torch.where(less, before + after - before * after, others)
        ridge = torch.where(less, here >= torch.maximum(before, after), ridge)
        across = torch.where(less, axis, across)
    return here + others - here * others, ridge, across


def around(occupancy: Tensor, at: Tensor) -> tuple[Tensor, *tuple[tuple[Tensor, Tensor], ...]]:
    """Of (M, 3) cells of an (X, Y, Z) grid their own values (M,), and along x, y and z those before and after them.

    Beyond the grid's borders is zero.
    """
    from torch.nn import functional as F

    padded = F.pad(occupancy, (1,) * 6)
    steps = padded.stride()
    flat = padded.view(-1)
    cell = (at + 1) @ at.new_tensor(steps)
    return flat[cell], *((flat[cell - step], flat[cell + step]) for step in steps)


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

    @property
    def around(self) -> tuple[int, int]:
        """The used part and a voxel on each side."""
        return self.used[0] - 1, self.used[1] + 1


def _span_count(size: int) -> int:
    """How many tiles there are along an axis."""
    return 1 if size <= TILE else len(range(0, size - 2 * HALO, STEP))


def _span(size: int, number: int) -> _Span:
    """That of a tile along an axis; used parts make up the whole, and all begin at multiples of the coarsest voxel."""
    if size <= TILE:
        return _Span((0, size), (0, size))
    start = STEP * number
    end = min(size, start + TILE)
    return _Span((start, end), (start + HALO if start else 0, end - HALO if end < size else size))
