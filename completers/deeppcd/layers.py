"""What the geometry and the colour network are made of: pooling over neighbours, and layers that read a patch once."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

Neighbors = tuple[Tensor, Tensor, Tensor, Tensor]  # the fields of `Neighborhoods`, in order


class SharedMLP(nn.Sequential):
    """Linear layers of these widths, each with a ReLU, shared by all points (..., widths[0]) -> (..., widths[-1])."""

    def __init__(self, *widths: int) -> None:
        super().__init__(*(nn.Linear(before, after) for before, after in pairwise(widths)))

    def forward(self, x: Tensor) -> Tensor:
        flat = x.flatten(0, -2)
        for layer in self:
            # In place, and on what is no view: autograd then neither copies nor keeps more than it must.
            flat = F.relu_(layer(flat))
        return flat.unflatten(0, x.shape[:-1])


def neighbor_max(features: Tensor, neighbors: Tensor) -> Tensor:
    """PConv: (P, N, C) features and (P, S, 32) int64 rows to (P, S, C), the maximum over the neighbours."""
    if torch.is_grad_enabled():
        # The fused operator notes which neighbour won; it runs on one thread.
        rows = neighbors + features.shape[1] * torch.arange(len(features), device=features.device)[:, None, None]
        pooled = F.embedding_bag(rows.flatten(0, 1), features.float().flatten(0, 1), mode="max")
        return pooled.to(features.dtype).unflatten(0, neighbors.shape[:2])
    pooled = features.new_empty(*neighbors.shape[:2], features.shape[2])
    for patch, rows, best in zip(features, neighbors, pooled, strict=True):
        first, *others = rows.t().contiguous()
        torch.index_select(patch, 0, first, out=best)
        for row in others:
            torch.maximum(best, patch.index_select(0, row), out=best)
    return pooled


def rows_of(values: Tensor, rows: Tensor) -> Tensor:
    """(P, N, C) values at (P, S) int64 rows: (P, S, C)."""
    return values.gather(1, rows[..., None].expand(-1, -1, values.shape[2]))


class SplitLinear(nn.Linear):
    """W [x; f] + b where f is the same for all points of a patch: W_x x + (W_f f + b), the second once a patch.

    Exactly the linear layer over the concatenation (rounding aside), at the cost of the points' part alone.

    Args:
        point: width of what differs from point to point.
        shared: width of what does not.
    """

    def __init__(self, point: int, shared: int, out: int) -> None:
        super().__init__(point + shared, out)
        self.point = point

    def forward(self, points: Tensor, shared: Tensor) -> Tensor:  # type: ignore[override]
        """(P, K, point) and (P, shared) to (P, K, out).

        Coordinates, which are what few inputs there are, keep their float32 whatever the precision around them.
        """
        once = F.linear(shared, self.weight[:, self.point :], self.bias)
        weight = self.weight[:, : self.point]
        if self.point > 4:
            return F.linear(points, weight) + once[:, None]
        with torch.autocast(points.device.type, enabled=False):
            # One product with a patch's own matrix [W_x | W_f f + b] writes the sum in a single pass.
            own = torch.cat([weight.t().expand(len(once), -1, -1), once.float()[:, None]], dim=1)
            return torch.bmm(F.pad(points, (0, 1), value=1.0), own)


class PatchEncoder(nn.Module):
    """The PointNet with two PConv layers that both networks begin with, its weights shared by all patches.

    Args:
        channels: of a point: 3, or 6 with colour.
        last: widths after the second PConv.
    """

    def __init__(self, channels: int, last: Sequence[int]) -> None:
        super().__init__()
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
        features = self.mlp_2(torch.cat([neighbor_max(fine, neighbors_1), middle.to(fine.dtype)], dim=2))
        coarse = rows_of(middle, sampled_2)
        features = neighbor_max(features, neighbors_2)
        patch = self.mlp_3(torch.cat([features, coarse.to(features.dtype)], dim=2)).amax(dim=1)
        return coarse, features, patch
