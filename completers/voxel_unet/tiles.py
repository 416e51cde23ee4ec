"""The network over a grid of any size: overlapping tiles, each of them predicted alone."""

from __future__ import annotations

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
        probability: (M,) of surface there, give or take a sub-voxel.
        colors: (M, 3) in [0, 1].
    """

    points: NDArray[np.float64]
    probability: NDArray[np.float32]
    colors: NDArray[np.float32]

    def select(self, rows: NDArray) -> Prediction:
        """The prediction at these rows (or at this mask)."""
        return Prediction(self.points[rows], self.probability[rows], self.colors[rows])


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
    found = [Prediction(none, np.zeros(0, np.float32), none.astype(np.float32))]
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
            probability, ridge = (part[inner] for part in surface(torch.sigmoid(out[0].float())))
            out = out[:, inner[0], inner[1], inner[2]]
            x, y, z = torch.nonzero(ridge & (probability > threshold), as_tuple=True)
            offsets, colors = placed(out[1:, x, y, z].T)
            corner = 2 * np.array([span.used[0] for span in tile])
            cells = torch.stack([x, y, z], dim=1).numpy() + corner + 0.5 + offsets.double().numpy()
            points = grid.origin + cells * (grid.edge_m / 2)
            found.append(Prediction(points, probability[x, y, z].numpy(), colors.numpy()))
    return Prediction(
        np.concatenate([part.points for part in found]),
        np.concatenate([part.probability for part in found]),
        np.concatenate([part.colors for part in found]),
    )


def surface(occupancy: Tensor) -> tuple[Tensor, Tensor]:
    """How likely surface is around each sub-voxel, and whether it is likeliest just there.

    Where a surface is certain but not how deep it lies, its occupancy is spread over a few sub-voxels, none of which
    is likely by itself. So occupancies are added up over a sub-voxel and its two neighbours along an axis, the axis
    on which they add up to most; and of the three the likeliest is where the surface is put. The sum is how many of
    the three are expected to be occupied, more than one where surface is slanted; that there is one at all has the
    probability 1 - exp(-sum), as for a Poisson process.

    Args:
        occupancy: (X, Y, Z) of the sub-voxels.

    Returns:
        (X, Y, Z) the probability, and the (X, Y, Z) mask of the likeliest.
    """
    import torch
    from torch.nn import functional as F

    padded = F.pad(occupancy, (1,) * 6)
    expected, ridge = torch.zeros_like(occupancy), torch.zeros_like(occupancy, dtype=torch.bool)
    inner = slice(1, -1)
    for axis in range(3):
        before, after = (
            padded[tuple(beside if other == axis else inner for other in range(3))]
            for beside in (slice(None, -2), slice(2, None))
        )
        together = occupancy + before + after
        more = together > expected
        ridge = torch.where(more, occupancy >= torch.maximum(before, after), ridge)
        expected = torch.where(more, together, expected)
    return -torch.expm1(-expected), ridge


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
