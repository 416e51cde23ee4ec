"""What patchwise networks are made of: MLPs of points, pooling over neighbours, layers that read a patch once."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

FEW = 8  # inputs of a point, at most, that are coordinates


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
    """(P, N, C) features and (P, S, k) int64 rows to (P, S, C), the maximum over the k neighbours."""
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
        """(P, K, point) and (P, shared) to (P, K, out)."""
        if self.point <= FEW:
            return moved_by(points, self.own(shared))
        once = F.linear(shared, self.weight[:, self.point :], self.bias)
        return F.linear(points, self.weight[:, : self.point]) + once[:, None]

    def own(self, shared: Tensor) -> Tensor:
        """(P, point + 1, out) float32: each patch's own matrix, [W_x | W_f f + b] transposed."""
        once = F.linear(shared, self.weight[:, self.point :], self.bias).float()
        return torch.cat([self.weight[:, : self.point].t().expand(len(once), -1, -1), once[:, None]], dim=1)


def moved_by(points: Tensor, own: Tensor) -> Tensor:
    """(P, K, C) coordinates through (P, C + 1, out) matrices of their patches: (P, K, out).

    One product writes the sum in a single pass. Coordinates keep their float32 whatever the precision around them.
    """
    with torch.autocast(points.device.type, enabled=False):
        return torch.bmm(F.pad(points, (0, 1), value=1.0), own)
