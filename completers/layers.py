"""What patchwise networks are made of: MLPs of points, pooling over neighbours, layers that read a patch once."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from pcdbench.threads import at_once, thread_count

SHARE_OF_NEW = 0.01  # the share with which each cloud enters the running means
FEW = 8  # inputs of a point, and fewer, are taken for coordinates, which keep their float32


class SharedMLP(nn.Sequential):
    """Linear layers of these widths, each with a ReLU, shared by all points (..., widths[0]) -> (..., widths[-1]).

    Args:
        slope: of the ReLU below zero.
    """

    def __init__(self, *widths: int, slope: float = 0.0) -> None:
        super().__init__(*(nn.Linear(before, after) for before, after in pairwise(widths)))
        self.slope = slope

    def forward(self, x: Tensor) -> Tensor:
        flat = x.flatten(0, -2)
        for layer in self:
            # In place, and on what is no view: autograd then neither copies nor keeps more than it must.
            flat = F.leaky_relu_(layer(flat), self.slope) if self.slope else F.relu_(layer(flat))
        return flat.unflatten(0, x.shape[:-1])


class _NeighborMax(torch.autograd.Function):
    """The maximum over neighbours, which notes which of them won."""

    @staticmethod
    def forward(ctx: Any, features: Tensor, neighbors: Tensor) -> Tensor:
        in_words = features.dtype == torch.bfloat16 and features.shape[1] <= 2**16
        pooled, winners = (_pooled_in_words if in_words else _pooled_in_parts)(features, neighbors)
        ctx.save_for_backward(winners)
        ctx.count = features.shape[1]
        return pooled

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        (grad,), (winners,) = grads, ctx.saved_tensors
        summed = grad.new_zeros(len(grad), ctx.count, grad.shape[2], dtype=torch.float32)
        return summed.scatter_add_(1, winners, grad.float()).to(grad.dtype), None


def _pooled_in_parts(features: Tensor, neighbors: Tensor) -> tuple[Tensor, Tensor]:
    """What `_pooled` gives, on several threads: the operator itself runs on one."""
    share = -(-len(features) // thread_count())
    parts = zip(features.split(share), neighbors.split(share), strict=True)
    pooled, winners = zip(*at_once(*(partial(_pooled, *part) for part in parts)), strict=True)
    return torch.cat(pooled), torch.cat(winners)


def _pooled(features: Tensor, neighbors: Tensor) -> tuple[Tensor, Tensor]:
    """(P, S, C) maxima and the (P, S, C) rows they are from."""
    count, device = features.shape[1], features.device
    rows = neighbors + count * torch.arange(len(features), device=device)[:, None, None]
    begins = torch.arange(0, rows.numel(), rows.shape[2], device=device)
    flat = features.flatten(0, 1).float()
    pooled, _, _, winners = torch.embedding_bag(flat, rows.flatten(), begins, mode=2)
    return pooled.unflatten(0, rows.shape[:2]).to(features.dtype), winners.unflatten(0, rows.shape[:2]) % count


def _pooled_in_words(features: Tensor, neighbors: Tensor) -> tuple[Tensor, Tensor]:
    """The same of bfloat16 features of 2^16 points a patch at most, many times as fast.

    A value and its row make one 32-bit word, so that the maximum of words tells both.
    """
    rows = torch.arange(features.shape[1], dtype=torch.int32, device=features.device)[:, None]
    best = _maxima((_ordered(features.view(torch.int16)).int() << 16) | rows, neighbors)
    return _ordered((best >> 16).short()).view(torch.bfloat16), (best & 0xFFFF).long()


def _ordered(bits: Tensor) -> Tensor:
    """The bits of floating point numbers as integers in the numbers' order, and back: its own inverse."""
    return bits ^ ((bits >> 15) & 0x7FFF)


def neighbor_max(features: Tensor, neighbors: Tensor) -> Tensor:
    """(P, N, C) features and (P, S, k) int64 rows to (P, S, C), the maximum over the k neighbours."""
    return _NeighborMax.apply(features, neighbors) if torch.is_grad_enabled() else _maxima(features, neighbors)


def _maxima(features: Tensor, neighbors: Tensor) -> Tensor:
    """(P, S, C): patch after patch, whose neighbours' features stay in the processor's cache."""
    pooled = features.new_empty(*neighbors.shape[:2], features.shape[2])
    for patch, rows, best in zip(features, neighbors, pooled, strict=True):
        torch.amax(patch.index_select(0, rows.flatten()).unflatten(0, rows.shape), dim=1, out=best)
    return pooled


def rows_of(values: Tensor, rows: Tensor) -> Tensor:
    """(P, N, C) values at (P, S) int64 rows: (P, S, C)."""
    return values.gather(1, rows[..., None].expand(-1, -1, values.shape[2]))


class Standardized(nn.Module):
    """Each channel less its mean, over its spread, both running means of training: no parameters.

    Maxima of ReLUs are far from zero, and nearly the same for all patches and points: unless that is taken away, what
    reads them sees a constant. Not batch normalisation: the patches of one cloud are too few, and may be one.
    """

    mean: Tensor
    variance: Tensor
    seen: Tensor

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(channels))
        self.register_buffer("variance", torch.ones(channels))
        self.register_buffer("seen", torch.zeros((), dtype=torch.int64))

    def forward(self, x: Tensor) -> Tensor:
        """(..., channels) to the same."""
        if self.training:
            with torch.no_grad():
                self.seen += 1
                share = max(SHARE_OF_NEW, 1 / int(self.seen))
                flat = x.flatten(0, -2).float()
                self.mean.lerp_(flat.mean(dim=0), share)
                self.variance.lerp_((flat - self.mean).square().mean(dim=0), share)
        # In float32: a mean that is many times the spread leaves little of a bfloat16.
        return ((x.float() - self.mean) * (self.variance + 1e-4).rsqrt()).to(x.dtype)


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


def begin(network: nn.Module) -> None:
    """Begin its layers before a ReLU as He et al. (ICCV 2015) do: what differs between inputs is not lost on the way.

    Torch's own weights are a sixth as large (in variance): after a dozen layers all patches give nearly the same, and
    what reads them dies before it learns to tell one from another.
    """
    for module in network.modules():
        if isinstance(module, SharedMLP):
            before_relu: list[nn.Module] = list(module)
        elif isinstance(module, SplitLinear):
            before_relu = [module]
        else:
            continue
        for layer in before_relu:
            nn.init.kaiming_normal_(layer.get_parameter("weight"), nonlinearity="relu")
            nn.init.zeros_(layer.get_parameter("bias"))


def moved_by(points: Tensor, own: Tensor) -> Tensor:
    """(P, K, C) coordinates through (P, C + 1, out) matrices of their patches: (P, K, out).

    One product writes the sum in a single pass. Coordinates keep their float32 whatever the precision around them.
    """
    with torch.autocast(points.device.type, enabled=False):
        return torch.bmm(F.pad(points, (0, 1), value=1.0), own)
