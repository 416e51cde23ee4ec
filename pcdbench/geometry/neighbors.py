"""Nearest neighbours by KD-trees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.geometry.duplicates import repeats
from pcdbench.threads import thread_count


def loose_tree(points: NDArray[np.float64]) -> cKDTree:
    """A KD-tree split at middles instead of medians: built in a third of the time, same answers to queries."""
    return cKDTree(points, balanced_tree=False, compact_nodes=False)


def nearest(queries: NDArray[np.float64], points: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """Distance to, and index of, the point nearest to each query: (Q,) metres and (Q,) int64.

    Coordinates are centred first, so that map offsets of 10^6 m cost no precision.
    """
    center = points.mean(axis=0)
    distances, index = loose_tree(points - center).query(queries - center, workers=thread_count())
    return distances, index


def median_spacing(points: NDArray[np.float64], at_most: int = 5000) -> float:
    """Median distance (metres) from a point to its nearest other point: the cloud's density in one number.

    Measured at every n-th point, and so at fewer than twice `at_most` of them. Duplicates do not count as neighbours;
    a cloud with fewer than two distinct points has spacing 0.
    """
    if len(points) < 2:
        return 0.0
    centered = points - points.mean(axis=0)
    step = max(1, len(points) // at_most)
    distances, _ = loose_tree(centered).query(centered[::step], k=min(4, len(points)), workers=thread_count())
    distances = np.where(distances > 0, distances, np.inf)[:, 1:].min(axis=1)
    apart = distances[np.isfinite(distances)]
    if 2 * len(apart) < len(distances):
        # Most see copies of themselves alone.
        distinct = points[~repeats(points)]
        if len(distinct) < len(points):
            return median_spacing(distinct, at_most)
    return float(np.median(apart)) if len(apart) else 0.0
