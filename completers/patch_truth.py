"""What patchwise networks learn towards: the truth, evenly sampled, patch by patch, and how far they are from it."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pcdbench.geometry.sampling import first_of_each
from pcdbench.training.chamfer import matched, mean_by_group

from .patches import Patches

TRUTH_POINTS = 16_384


def evenly(points: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """About `count` rows of (N, 3) points, metres, as many wherever there is surface: a random one of each voxel."""
    order = rng.permutation(len(points))
    shifted = points[order] - points.min(axis=0)
    edge_m = 0.08
    for _ in range(3):
        x, y, z = np.floor(shifted / edge_m + rng.random(3)).astype(np.int64).T
        first = first_of_each((x * (y.max() + 1) + y) * (z.max() + 1) + z)
        edge_m *= float(np.sqrt(len(first) / count))
    return order[first]


def true_rows(patches: Patches, scaled: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """By patch, the rows of (T, 3) true points, in the unit of the grid, that belong to it."""
    of_cell = patches.grid.members(scaled)
    return [of_cell[number] for number in patches.number]


def true_patches(patches: Patches, scaled: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """(U,) the patch and (U, 3) the position in it of what of (T, 3) true points belongs to a patch.

    Patches without any true point (a few floating points, say) get the observed ones, which then are all there is.
    """
    members = true_rows(patches, scaled)
    points = [
        (scaled[rows] - low) / patches.scale if len(rows) else observed
        for rows, low, observed in zip(members, patches.low, patches.points, strict=True)
    ]
    of = np.repeat(np.arange(len(points)), [len(inside) for inside in points])
    return of, np.concatenate(points).astype(np.float32)


def distances_by_patch(found: Tensor, truth: Tensor, truth_of: Tensor, power: int) -> tuple[Tensor, Tensor]:
    """(P,) mean distances to the truth and (P,) from it, to this power, of (P, K, 3) points and (U, 3) true ones.

    Args:
        truth_of: (U,) the patch of each true point.
        power: 1, or 2 for squared distances.
    """
    patches, count = found.shape[:2]
    found_of = torch.arange(patches, device=found.device).repeat_interleave(count)
    steps = matched(found.flatten(0, 1), truth, found_of, truth_of)
    # The square root of 0 has no gradient; a millionth of a patch is none that matters.
    to_truth, from_truth = (
        step.square().sum(dim=1) if power == 2 else (step.square().sum(dim=1) + 1e-12).sqrt() for step in steps
    )
    return mean_by_group(to_truth, found_of, patches), mean_by_group(from_truth, truth_of, patches)
