"""The surface near each point of a cloud: how densely it is sampled, and the plane it lies in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.threads import thread_count

NEIGHBORS = 12
# With this radius, in spacings, the rounds of dart throwing end at the density 1 / spacing^2 (measured: a radius of
# 0.83 would do if they were maximal, as random packings cover 0.547 of the plane).
RADIUS_OF_SPACING = 0.7


def spacing_at(places: NDArray[np.float64], tree: cKDTree, count: int = 6) -> NDArray[np.float64]:
    """(M,) metres between neighbours at (M, 3) points of a cloud, were it sampled on a square grid as densely there.

    A circle on a surface of density d holds `count` points besides its centre at a radius of sqrt(count / (pi d)).

    Args:
        places: points of the cloud, metres.
        tree: of the cloud.
        count: how many neighbours; more are steadier and see less detail.
    """
    k = min(count + 1, tree.n)
    distances, _ = tree.query(places, k=[k], workers=thread_count())
    return distances[:, 0] / np.sqrt(count / np.pi)


def spacing_inside(places: NDArray[np.float64], tree: cKDTree, everything: cKDTree) -> NDArray[np.float64]:
    """(M,) metres: the spacing of `everything` at (M, 3) points of a thinner cloud, as it is away from rims.

    A point on the rim of a hole lacks half of its neighbours and seems to lie in a sparser surface than it does. So
    a low quantile of what the points around measure counts.

    Args:
        places: points of the thinner cloud, metres.
        tree: of the thinner cloud, in the order of `places`.
        everything: of the whole cloud.
    """
    measured = spacing_at(places, everything, count=12)
    _, index = tree.query(places, k=min(24, tree.n), workers=thread_count())
    return np.quantile(measured[index.reshape(len(places), -1)], 0.3, axis=1)


def local_planes(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3) unit normals of either sign, and (N,) metres: how far the nearest points scatter about the plane.

    A point takes the plane of that neighbour whose own neighbours scatter least, among those planes that pass it
    closely: so normals do not turn at edges, where two surfaces meet.

    Args:
        points: (N, 3) metres, near the origin.
    """
    distances, index = cKDTree(points).query(points, k=min(NEIGHBORS, len(points)), workers=thread_count())
    index = index.reshape(len(points), -1)
    near = points[index]
    centers = near.mean(axis=1)
    near = near - centers[:, None]
    spread, axes = np.linalg.eigh(near.transpose(0, 2, 1) @ near / index.shape[1])
    normals, scatter = axes[:, :, 0], np.sqrt(np.maximum(spread[:, 0], 0.0))
    heights = np.abs(np.einsum("nki,nki->nk", normals[index], points[:, None] - centers[index]))
    reach = distances.reshape(len(points), -1)[:, -1:]
    cost = np.where(heights <= 0.15 * reach, scatter[index] + heights, np.inf)
    cost[:, 0] = np.minimum(cost[:, 0], scatter + heights[:, 0])
    best = index[np.arange(len(points)), cost.argmin(axis=1)]
    return normals[best], scatter[best]


def tangents(normals: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3) and (N, 3) unit vectors that span the planes of (N, 3) unit normals."""
    helper = np.where(np.abs(normals[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(helper, normals)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normals, first)
