"""What DeepPCD's geometry and colour network begin with: a PointNet with two PConv layers."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from ..layers import SharedMLP, Standardized, neighbor_max, rows_of

Neighbors = tuple[Tensor, Tensor, Tensor, Tensor]  # the fields of `Neighborhoods`, in order
NEAREST = 8  # of the second PConv's neighbours: with 32 a floor near a wall looks like a wall


class PatchEncoder(nn.Module):
    """A PointNet with two PConv layers (sampling, and the maximum over neighbours), its weights shared by all patches.

    Args:
        channels: of a point: 3, or 6 with colour.
        last: widths after the second PConv.
        local: the first PConv tells by how much the maximum exceeds the sampled point's own feature, standardised;
            the second looks at the nearest 8 neighbours alone, and what it tells is standardised.
    """

    def __init__(self, channels: int, last: Sequence[int], local: bool = False) -> None:
        super().__init__()
        self.rise = Standardized(128) if local else None
        self.of_points = Standardized(384) if local else None
        self.mlp_1 = SharedMLP(channels, 64, 128)
        self.mlp_2 = SharedMLP(128 + 3, 256, 384)
        self.mlp_3 = SharedMLP(384 + 3, *last)

    def forward(self, points: Tensor, extra: Tensor | None, around: Neighbors) -> tuple[Tensor, Tensor, Tensor]:
        """The N / 8 points (P, N / 8, 3) sampled last with their features (P, N / 8, 384), and the patch's (P, last).

        Args:
            points: (P, N, 3), each patch scaled to [0, 1].
            extra: (P, N, channels - 3) or None: what else is known of each point.
        """
        sampled_1, neighbors_1, sampled_2, neighbors_2 = (rows.long() for rows in around)
        fine = self.mlp_1(points if extra is None else torch.cat([points, extra], dim=2))
        middle = rows_of(points, sampled_1)
        pooled = neighbor_max(fine, neighbors_1)
        if self.rise is not None:
            # How far the surface goes in which direction, wherever it is: a plane's normal can be read from that.
            pooled = self.rise(pooled - rows_of(fine, sampled_1))
            neighbors_2 = neighbors_2[:, :, :NEAREST]
        features = self.mlp_2(torch.cat([pooled, middle.to(pooled.dtype)], dim=2))
        coarse = rows_of(middle, sampled_2)
        features = neighbor_max(features, neighbors_2)
        if self.of_points is not None:
            # Features that are all positive keep half of the units that read them off, and the others on, for good.
            features = self.of_points(features)
        patch = self.mlp_3(torch.cat([features, coarse.to(features.dtype)], dim=2)).amax(dim=1)
        return coarse, features, patch
