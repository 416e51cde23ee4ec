"""PCN's network: a PointNet twice over, coarse points by fully connected layers, fine ones by folding grids."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..layers import SharedMLP, SplitLinear

CODE = 1024
COARSE = 1024
GRID_SIDE = 4
GRID_HALF_WIDTH = 0.05
MIDDLE = 0.5  # of a patch; the published objects lie around the origin
FINE = COARSE * GRID_SIDE**2


class PCNNetwork(nn.Module):
    """PCN as published (Yuan et al. 2018, section 4): a code of 1,024, as many coarse points, 16,384 fine ones."""

    def __init__(self) -> None:
        super().__init__()
        self.low = nn.Sequential(SharedMLP(3, 128), nn.Linear(128, 256))
        self.high = SplitLinear(256, 256, 512)
        self.code = nn.Linear(512, CODE)
        self.coarse = nn.Sequential(SharedMLP(CODE, 1024, 1024), nn.Linear(1024, 3 * COARSE))
        self.fold = SplitLinear(5, CODE, 512)
        self.fine = nn.Sequential(SharedMLP(512, 512), nn.Linear(512, 3))

    def forward(self, points: Tensor, chosen: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Coarse (P, 1024, 3) and fine (P, K, 3) float32 points of (P, N, 3) observed ones.

        Each patch is completed on its own; all are scaled to [0, 1].

        Args:
            chosen: (P, K) int64, which of the 16,384 fine points to fold; all of them where it is None.
        """
        code = self.encoded(points - MIDDLE)
        coarse = self.coarse(code).float().unflatten(1, (COARSE, 3))
        if chosen is None:
            chosen = torch.arange(FINE, device=points.device).expand(len(points), -1)
        line = torch.linspace(-GRID_HALF_WIDTH, GRID_HALF_WIDTH, GRID_SIDE, device=points.device)
        cell = torch.cartesian_prod(line, line)[chosen % GRID_SIDE**2]
        center = coarse.gather(1, (chosen // GRID_SIDE**2)[..., None].expand(-1, -1, 3))
        folded = F.relu_(self.fold(torch.cat([cell, center], dim=2), code))
        return coarse + MIDDLE, center + self.fine(folded).float() + MIDDLE

    def encoded(self, points: Tensor) -> Tensor:
        """(P, 1024) codes."""
        low = self.low(points)
        return self.code(F.relu_(self.high(low, low.amax(dim=1)))).amax(dim=1)
