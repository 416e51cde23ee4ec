"""The surface that a cloud samples, near each point: how far its points are apart, and its normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.threads import thread_count


def unoriented_normals(points: NDArray[np.float64], neighbors: int = 12) -> NDArray[np.float64]:
    """(N, 3) unit normals, of either sign: the direction of least spread of a point's nearest `neighbors`.

    Args:
        points: (N, 3) metres, near the origin.
    """
    _, index = cKDTree(points).query(points, k=min(neighbors, len(points)), workers=thread_count())
    spread = points[index.reshape(len(points), -1)]
    spread = spread - spread.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(spread.transpose(0, 2, 1) @ spread)
    return axes[:, :, 0]


def surface_spacing(points: NDArray[np.float64]) -> float:
    """Metres between neighbours if the surface were sampled on a square grid of the same density.

    From the median distance to the sixth neighbour, which (unlike the first) is about the same for random, evenly
    spaced and gridded samples: on a surface of density d a circle of radius sqrt(6 / (pi d)) holds six.

    Args:
        points: (N, 3) metres, near the origin, N at least 7.
    """
    step = max(1, len(points) // 5000)
    distances, _ = cKDTree(points).query(points[::step], k=7, workers=thread_count())
    return float(np.median(distances[:, 6])) / float(np.sqrt(6 / np.pi))
