"""The geometry network: patch features, their relations, plane points, and their displacement to the surface."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..layers import SharedMLP, SplitLinear, Standardized, begin, moved_by
from .encoder import Neighbors, PatchEncoder

FEATURE = 768
POINT_FEATURE = 384
LONGEST_WAVE = 1e4  # times the shortest, which is 2 pi cells
GRID_SIDE = 4  # points along a side of the planar grid
GRID_HALF_WIDTH = 0.14  # of the patch: seeds are about an eighth apart, so planes reach into holes
GRID_HEIGHT = 2 * GRID_HALF_WIDTH  # of the planar grid: the matrix's last column moves it, into holes beside the seed
COORDINATES_STD = 5.0  # where in its patch a point lies then has as much of a say as what the patch looks like
TOGETHER = 2  # patches


class Completed(NamedTuple):
    """What the geometry network gives.

    Attributes:
        planes: (P, K, 3) float32 plane points, before any displacement, as patches are scaled.
        patches: (P, K, 3) float32 after the local displacement, likewise.
        points: (P * K, 3) float32 after the global one, in the unit of the grid: the result.
        turns: (P, S, 3, 3) float32 of the plane point generator, or None without it.
    """

    planes: Tensor
    patches: Tensor
    points: Tensor
    turns: Tensor | None


class DeepPCDNetwork(nn.Module):
    """DeepPCD's geometry network, Figures and tables of the publication read literally: 7,735,055 parameters.

    Args:
        plane_points: of a patch; a multiple of 16, at most 2,048.
        generator: without it plane points are one fixed grid on the patch's xy plane (the publication's ablation).
    """

    def __init__(self, plane_points: int = 1024, generator: bool = True) -> None:
        super().__init__()
        self.plane_points = plane_points
        self.encoder = PatchEncoder(3, (512, FEATURE), local=True)
        begin(self.encoder)
        # First each patch by itself: otherwise features grow and grow, since what reads them takes their size away.
        self.of_patches = nn.Sequential(nn.LayerNorm(FEATURE, elementwise_affine=False), Standardized(FEATURE))
        self.relations = Relations()
        self.generator = PlanePointGenerator() if generator else None
        self.local_displacement = Displacement()
        self.global_displacement = Displacement()

    def forward(
        self,
        points: Tensor,
        around: Neighbors,
        cells: Tensor,
        low: Tensor,
        scale: Tensor,
        chosen: Tensor | None = None,
    ) -> Completed:
        """Complete the P patches of one cloud.

        Args:
            points: (P, N, 3) float32, each patch scaled to [0, 1].
            around: their `Neighborhoods`.
            cells: (P, 2) positions in the grid.
            low: (P, 3) and `scale`, which take patches to the unit of the grid.
            chosen: (P, K) int64, the plane points to go on with; all of them where it is None.
        """
        coarse, features, patch = self.encoder(points, None, around)
        patch = self.relations(self.of_patches(patch), cells)
        turns = None
        if self.generator is None:
            planes = _flat_grid(self.plane_points, points.device).expand(len(points), -1, -1)
        else:
            seeds = self.plane_points // GRID_SIDE**2
            turns = self.generator(coarse[:, :seeds], features[:, :seeds], patch)
            planes = plane_points(coarse[:, :seeds], turns)
        if chosen is not None:
            planes = planes.gather(1, chosen[..., None].expand(-1, -1, 3))
        local = planes + self.local_displacement(planes, patch)
        merged = low[:, None] + scale * local
        whole = merged + self.global_displacement(merged, patch.amax(dim=0, keepdim=True).expand_as(patch))
        return Completed(planes, local, whole.flatten(0, 1), turns)


class Relations(nn.Module):
    """One transformer encoder layer with one head over the patches of a cloud, told where each of them is.

    Normalised before attention and before the MLP; both have a residual.
    """

    def __init__(self) -> None:
        super().__init__()
        self.norm_1, self.norm_2 = nn.LayerNorm(FEATURE), nn.LayerNorm(FEATURE)
        self.query, self.key, self.value, self.context = (nn.Linear(FEATURE, FEATURE) for _ in range(4))
        self.mlp = nn.Sequential(nn.Linear(FEATURE, 1024), nn.GELU(), nn.Linear(1024, FEATURE))

    def forward(self, patches: Tensor, cells: Tensor) -> Tensor:
        """(P, 768) patch features at (P, 2) cells to (P, 768), each with what the others tell."""
        x = patches + position_embedding(cells).to(patches.dtype)
        normal = self.norm_1(x)
        attended = F.scaled_dot_product_attention(
            self.query(normal)[None], self.key(normal)[None], self.value(normal)[None]
        )[0]
        x = x + self.context(attended)
        return x + self.mlp(self.norm_2(x))


def position_embedding(cells: Tensor, width: int = FEATURE) -> Tensor:
    """(P, width) float32 embedding of (P, 2) positions.

    Tuples sin x sin y, sin x cos y, cos x sin y, cos x cos y, with wavelengths in geometric progression from 2 pi to
    10^4 * 2 pi. The product of two embeddings depends on their positions' difference alone, and moving by a difference
    is a linear map that does not depend on where from.
    """
    waves = width // 4
    exponents = torch.arange(waves, dtype=torch.float64, device=cells.device) / (waves - 1)
    x, y = (cells.double()[:, :, None] * LONGEST_WAVE**-exponents).unbind(dim=1)
    tuples = [x.sin() * y.sin(), x.sin() * y.cos(), x.cos() * y.sin(), x.cos() * y.cos()]
    return torch.stack(tuples, dim=2).flatten(1).float()


class PlanePointGenerator(nn.Module):
    """A 3 x 3 matrix for each sampled point, that turns a planar grid into plane points around it."""

    def __init__(self) -> None:
        super().__init__()
        self.first = SplitLinear(POINT_FEATURE + 3, FEATURE, 1024)
        last = nn.Linear(256, 9)
        self.rest = nn.Sequential(SharedMLP(1024, 512, 256), last)
        begin(self)
        with torch.no_grad():
            # The patch's feature, two thirds of the inputs, begins with little of a say: it is the same for all points.
            self.first.weight[:, POINT_FEATURE + 3 :].mul_(0.1)
            last.weight.mul_(0.1)
            last.bias.copy_(_oblique().flatten())

    def forward(self, points: Tensor, features: Tensor, patch: Tensor) -> Tensor:
        """(P, S, 3, 3) float32 of (P, S, 3) points, their features (P, S, 384) and their patch's (P, 768)."""
        x = torch.cat([features, points.to(features.dtype)], dim=2)
        return self.rest(F.relu_(self.first(x, patch))).float().unflatten(2, (3, 3))


def plane_points(points: Tensor, turns: Tensor) -> Tensor:
    """(P, S * 16, 3): the 4 x 4 planar grid at (P, S, 3) points, turned, stretched and moved by (P, S, 3, 3) matrices.

    A matrix's first two columns are the plane; the grid's height times the last is how far it is moved.
    """
    line = torch.linspace(-GRID_HALF_WIDTH, GRID_HALF_WIDTH, GRID_SIDE, device=points.device)
    grid = F.pad(torch.cartesian_prod(line, line), (0, 1), value=GRID_HEIGHT)
    with torch.autocast(points.device.type, enabled=False):
        return (points[:, :, None] + grid @ turns.transpose(2, 3)).flatten(1, 2)


def _oblique() -> Tensor:
    """(3, 3) the matrix that puts the grid at its point, along the plane whose normal is (1, 1, 1) / sqrt 3.

    From there floors and walls are equally far, and each is nearest in one sense of turning. A level plane at a wall
    does not know which way to turn: both ways it leans equally, and the gradient is zero.
    """
    first = torch.tensor([1.0, -1.0, 0.0]) / 2**0.5
    second = torch.linalg.cross(torch.full((3,), 3**-0.5), first)
    return torch.stack([first, second, torch.zeros(3)], dim=1)


def _flat_grid(count: int, device: torch.device) -> Tensor:
    """(count, 3) a regular grid over the patch's unit square at its lowest height."""
    side = math.ceil(math.sqrt(count))
    line = (torch.arange(side, device=device) + 0.5) / side
    return F.pad(torch.cartesian_prod(line, line)[:count], (0, 1))


class Displacement(nn.Module):
    """How far to move each point, of what is known of its patch or of the whole cloud."""

    def __init__(self) -> None:
        super().__init__()
        self.first = SplitLinear(3, FEATURE, 512)
        self.second = nn.Linear(512, 256)
        self.norm = nn.LayerNorm(256)
        last = nn.Linear(64, 3)
        self.rest = nn.Sequential(SharedMLP(256, 256, 64, slope=0.1), last)
        begin(self)
        with torch.no_grad():
            # Three of 771 inputs begin with no say, and all points of a patch would be moved as one.
            coordinates = nn.init.normal_(self.first.weight[:, :3], std=COORDINATES_STD)
            self.first.bias.copy_(-coordinates.sum(dim=1) / 2)
            # Plane points begin where they are. Moved together by a bias of a tenth of a patch, or of the whole cloud,
            # the network learns before all else to move nothing, and its units die of it.
            last.weight.mul_(0.01)
            last.bias.zero_()

    def forward(self, points: Tensor, feature: Tensor) -> Tensor:
        """(P, K, 3) float32 displacements in (-1, 1) of (P, K, 3) points with their (P, 768) features."""
        moved = []
        # A few patches at a time stay in the processor's cache from layer to layer.
        for some, own in zip(points.split(TOGETHER), self.first.own(feature).split(TOGETHER), strict=True):
            x = F.relu_(moved_by(some, own))
            moved.append(torch.tanh(self.rest(self.norm(self.second(x))).float()))
        return torch.cat(moved)
