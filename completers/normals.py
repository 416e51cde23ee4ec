"""Surface normals of a cloud, by the spread of each point's neighbours."""

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
