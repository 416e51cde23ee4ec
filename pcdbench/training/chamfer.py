"""Chamfer distances as losses: KD-trees find who is nearest to whom, and the matched differences are differentiated."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pcdbench.geometry.neighbors import loose_tree
from pcdbench.threads import thread_count

_APART = 1e3  # groups are put so far from each other that one KD-tree serves them all


def matched(
    found: Tensor, truth: Tensor, found_of: Tensor | None = None, truth_of: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """(N, 3) from each found point to the true point nearest to it, and (M, 3) from each true point to the found one.

    In float32 whatever the precision around it; the mean squared lengths of both are the Chamfer distance.

    Args:
        found: (N, 3), of coordinates below 100.
        truth: (M, 3).
        found_of: (N,) the group of each found point, with `truth_of`, (M,): points match within their group. A group
            must have points on both sides.
    """
    found, truth = found.float(), truth.float()
    placed_found, placed_truth = _placed(found, found_of), _placed(truth, truth_of)
    to_truth = _nearest(placed_found, placed_truth).to(found.device)
    to_found = _nearest(placed_truth, placed_found).to(found.device)
    return found - truth[to_truth], truth - found[to_found]


def mean_by_group(values: Tensor, of: Tensor, groups: int) -> Tensor:
    """(groups,) means of (N,) values by their (N,) group; 0 where a group has none."""
    total = values.new_zeros(groups).index_add(0, of, values)
    return total / torch.bincount(of, minlength=groups).clamp(min=1)


def _placed(points: Tensor, of: Tensor | None) -> NDArray[np.float64]:
    placed = points.detach().cpu().double().numpy()
    if of is not None:
        placed[:, 0] += _APART * of.cpu().numpy()
    return placed


def _nearest(queries: NDArray[np.float64], points: NDArray[np.float64]) -> Tensor:
    return torch.from_numpy(loose_tree(points).query(queries, workers=thread_count())[1])
