"""FoldingNet's network: an encoder on the graph of nearest neighbours, and a planar grid folded twice by its code."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..layers import SharedMLP, SplitLinear, neighbor_max

CODE = 512
GRID_SIDE = 45
GRID_HALF_WIDTH = 0.3
FOLDED = GRID_SIDE**2
MIDDLE = 0.5  # of a patch; the published objects lie around the origin


class FoldingNetNetwork(nn.Module):
    """FoldingNet as published (Yang et al. 2018, section 3): 512-d code, two foldings of a 45 x 45 grid."""

    def __init__(self) -> None:
        super().__init__()
        self.points = SharedMLP(12, 64, 64, 64)
        self.graph_1 = SharedMLP(64, 128)
        self.graph_2 = SharedMLP(128, 1024)
        self.code = nn.Sequential(nn.Linear(1024, CODE), nn.ReLU(), nn.Linear(CODE, CODE))
        self.fold_1, self.fold_2 = Folding(2), Folding(3)

    def forward(self, points: Tensor, neighbors: Tensor, chosen: Tensor | None = None) -> Tensor:
        """(P, K, 3) float32 points of (P, N, 3) observed ones, each patch on its own and scaled to [0, 1].

        Args:
            neighbors: (P, N, 16) rows of the nearest points, itself one of them.
            chosen: (P, K) int64, which of the 2,025 points of the grid to fold; all of them where it is None.
        """
        code = self.encoded(points - MIDDLE, neighbors.long())
        line = torch.linspace(-GRID_HALF_WIDTH, GRID_HALF_WIDTH, GRID_SIDE, device=points.device)
        grid = torch.cartesian_prod(line, line)
        grid = grid.expand(len(points), -1, -1) if chosen is None else grid[chosen]
        return self.fold_2(self.fold_1(grid, code), code) + MIDDLE

    def encoded(self, points: Tensor, neighbors: Tensor) -> Tensor:
        """(P, 512) codes."""
        near = points.gather(1, neighbors.flatten(1)[..., None].expand(-1, -1, 3)).unflatten(1, neighbors.shape[1:])
        off = near - near.mean(dim=2, keepdim=True)
        covariance = (off.transpose(2, 3) @ off).float() / neighbors.shape[2]
        x = self.points(torch.cat([points, covariance.flatten(2)], dim=2))
        x = self.graph_1(neighbor_max(x, neighbors))
        x = self.graph_2(neighbor_max(x, neighbors))
        return self.code(x.amax(dim=1))


class Folding(nn.Module):
    """What a three-layer perceptron makes of a patch's code and points of a grid, or of its first folding."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = SplitLinear(channels, CODE, 512)
        self.rest = nn.Sequential(SharedMLP(512, 512), nn.Linear(512, 3))

    def forward(self, points: Tensor, code: Tensor) -> Tensor:
        """(P, K, channels) and (P, 512) to (P, K, 3) float32."""
        return self.rest(F.relu_(self.first(points, code))).float()
