"""Planes of a cloud, by RANSAC over points with normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

HYPOTHESES = 1000
SAMPLE = 4000
REFITS = 4
MIN_COSINE = 0.8


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane and the points it was found by.

    Attributes:
        normal: (3,) unit normal, of either sign.
        offset: the plane is where `normal @ x == offset`, metres.
        inliers: (M,) rows of the cloud.
    """

    normal: NDArray[np.float64]
    offset: float
    inliers: NDArray[np.int64]


def planes(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    distance_m: float,
    min_points: int,
    at_most: int,
    rng: np.random.Generator,
) -> list[Plane]:
    """The planes of a cloud, the one with most points first; no point belongs to two.

    RANSAC with normals (Schnabel, Wahl and Klein 2007): one point with its normal is a hypothesis, and a point
    agrees with it within `distance_m` and about 37 degrees of its normal. All hypotheses are scored at once on
    a sample of the cloud; the best one is refitted to all points and those it takes no longer count for others.

    Args:
        points: (N, 3) metres, near the origin.
        normals: (N, 3) unit normals, of either sign.
        min_points: planes with fewer inliers are not returned.
    """
    total = len(points)
    sample = rng.permutation(total)[:SAMPLE]
    seeds = rng.permutation(total)[:HYPOTHESES]
    sample_points, sample_normals = points[sample].astype(np.float32), normals[sample].astype(np.float32)
    seed_normals = normals[seeds].astype(np.float32)
    seed_offsets = np.einsum("ij,ij->i", normals[seeds], points[seeds]).astype(np.float32)
    agrees = np.abs(sample_points @ seed_normals.T - seed_offsets) <= distance_m
    agrees &= np.abs(sample_normals @ seed_normals.T) >= MIN_COSINE
    counts = agrees.sum(axis=0)
    free = np.ones(total, dtype=bool)
    found: list[Plane] = []
    while len(found) < at_most:
        best = int(counts.argmax())
        if counts[best] < max(3, min_points * len(sample) / total / 2):
            break
        supporters = sample[agrees[:, best] & free[sample]]
        agrees[:, best] = False
        counts[best] = 0
        inliers = supporters
        for fit in range(REFITS):
            normal, offset = _least_squares(points[inliers])
            # All but the last fit look at the sample alone: enough to straighten the plane.
            rows = sample[free[sample]] if fit < REFITS - 1 else np.flatnonzero(free)
            near = np.abs(points[rows] @ normal - offset) <= distance_m
            rows = rows[near]
            inliers = rows[np.abs(normals[rows] @ normal) >= MIN_COSINE]
            if len(inliers) < 3:
                break
        if len(inliers) < min_points:
            continue
        found.append(Plane(normal, offset, inliers))
        taken = free.copy()
        free[inliers] = False
        counts -= agrees[(taken & ~free)[sample]].sum(axis=0)
    return sorted(found, key=lambda plane: -len(plane.inliers))


def _least_squares(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Unit normal and offset of the plane with the least squared distances to (N, 3) points, N at least 3."""
    center = points.mean(axis=0)
    spread = points - center
    _, axes = np.linalg.eigh(spread.T @ spread)
    return axes[:, 0], float(axes[:, 0] @ center)
