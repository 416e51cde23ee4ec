"""The surface that a cloud samples, near each point: how far its points are apart, and its normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.geometry.neighbors import loose_tree
from pcdbench.geometry.sampling import apart_indices
from pcdbench.threads import thread_count


def unoriented_normals(
    points: NDArray[np.float64],
    neighbors: int = 12,
    at: NDArray[np.float64] | None = None,
    tree: cKDTree | None = None,
) -> NDArray[np.float64]:
    """(N, 3) unit normals, of either sign: the direction of least spread of a point's nearest `neighbors`.

    Args:
        points: (N, 3) metres, near the origin.
        at: (M, 3) places whose normals are asked for instead, (M, 3).
        tree: of the points, where there is one already.
    """
    at = points if at is None else at
    tree = cKDTree(points) if tree is None else tree
    _, index = tree.query(at, k=min(neighbors, len(points)), workers=thread_count())
    return planes(points[index.reshape(len(at), -1)])[1]


def planes(near: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The mean (N, 3) of each K of (N, K, 3) points, and the unit normal (N, 3), of either sign, of their plane."""
    center = near.mean(axis=1)
    spread = near - center[:, None]
    return center, np.linalg.eigh(spread.transpose(0, 2, 1) @ spread)[1][:, :, 0]


def surface_spacing(points: NDArray[np.float64], tree: cKDTree | None = None) -> float:
    """Metres between neighbours if the surface were sampled on a square grid of the same density.

    From the median distance to the sixth neighbour, which (unlike the first) is about the same for random, evenly
    spaced and gridded samples: on a surface of density d a circle of radius sqrt(6 / (pi d)) holds six.

    Args:
        points: (N, 3) metres, near the origin, N at least 7.
        tree: of the points, where there is one already.
    """
    step = max(1, len(points) // 5000)
    distances, _ = (loose_tree(points) if tree is None else tree).query(points[::step], k=7, workers=thread_count())
    return float(np.median(distances[:, 6])) / float(np.sqrt(6 / np.pi))


def spread_evenly(
    places: NDArray[np.float64],
    observed: NDArray[np.float64],
    spacing_m: float,
    apart_spacings: float,
    rng: np.random.Generator,
    *,
    neighbors: int,
    jitters: int,
    reach: float = 1.0,
    tree: cKDTree | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points evenly spread over the surface that places lie on, no nearer to one another and to any observed point.

    Each place gives a few candidates, spread over the plane that fits its neighbours, places and observed points
    (so the layer is thin where neighbours agree); blue noise chooses among them.

    Args:
        places: (N, 3) metres, near the origin.
        observed: (M, 3) metres.
        spacing_m: of the observed points.
        apart_spacings: how far points keep apart, in spacings.
        neighbors: how many a plane is fitted to.
        jitters: candidates a place.
        reach: how far about candidates lie, in spacings.
        tree: of the observed points, where there is one already.

    Returns:
        (K, 3) the points, and (K,) the rows of the places they came from.
    """
    if not len(places):
        return places, np.zeros(0, np.int64)
    support = np.concatenate([places, observed])
    _, index = loose_tree(support).query(places, k=min(neighbors, len(support)), workers=thread_count())
    center, normals = planes(support[index])
    candidates = places + reach * spacing_m * rng.uniform(-0.5, 0.5, (jitters, *places.shape))
    heights = np.einsum("jni,ni->jn", candidates - center, normals)
    candidates = (candidates - heights[..., None] * normals).reshape(-1, 3)
    everything = np.concatenate([observed, candidates])
    rows = apart_indices(everything, apart_spacings * spacing_m, rng, fixed=len(observed), tree=tree)
    chosen = rows[len(observed) :] - len(observed)
    return candidates[chosen], chosen % len(places)
