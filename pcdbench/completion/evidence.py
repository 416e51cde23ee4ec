"""How well what was observed supports a proposed point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.completion.surface import tangents
from pcdbench.geometry.sampling import apart_indices
from pcdbench.threads import thread_count

SECTORS = 8
NEAREST = 12
SURROUNDING = 48
# At this distance from the nearest observed point (metres) the factor of distance is 1/e.
FADING_M = 2.0


def evidence(
    proposed: NDArray[np.float64],
    proposed_normals: NDArray[np.float64],
    observed: NDArray[np.float64],
    observed_normals: NDArray[np.float64],
    spacing_m: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """(K, 3) in [0, 1]: the factors of distance, agreement and enclosure of each proposed point.

    - distance: exp(-d / 2 m), d the distance to the nearest observed point.
    - agreement: exp(-h / s), s the spacing, h the distance of the point from the planes of its 12 nearest observed
      points: the lower quartile, so that at an edge one of two surfaces is enough.
    - enclosure: (1 + e) / 2, e the share of eight sectors of the point's plane in which observed points continue
      it: no higher above it than a quarter of their distance and half a spacing. Between observed surfaces a
      completer interpolates; beyond them it guesses.

    Args:
        proposed: (K, 3) metres, near the origin.
        proposed_normals: (K, 3) unit.
        observed: (N, 3) metres, N at least 1.
        observed_normals: (N, 3) unit.
        spacing_m: of the observed points.
        rng: decides which observed points stand for their surroundings.
    """
    if not len(proposed):
        return np.empty((0, 3))
    tree = cKDTree(observed)
    distances, index = tree.query(proposed, k=min(NEAREST, len(observed)), workers=thread_count())
    distances, index = distances.reshape(len(proposed), -1), index.reshape(len(proposed), -1)
    heights = np.abs(np.einsum("nki,nki->nk", observed_normals[index], proposed[:, None] - observed[index]))
    distance = np.exp(-distances[:, 0] / FADING_M)
    agreement = np.exp(-np.quantile(heights, 0.25, axis=1) / spacing_m)

    coarse = observed[apart_indices(observed, 2 * spacing_m, rng)]
    _, around = cKDTree(coarse).query(proposed, k=min(SURROUNDING, len(coarse)), workers=thread_count())
    steps = coarse[around.reshape(len(proposed), -1)] - proposed[:, None]
    first, second = tangents(proposed_normals)
    u, v, w = (np.einsum("nki,ni->nk", steps, axis) for axis in (first, second, proposed_normals))
    continues = np.abs(w) <= 0.25 * np.hypot(u, v) + 0.5 * spacing_m
    sector = np.floor((np.arctan2(v, u) + np.pi) / (2 * np.pi) * SECTORS).astype(np.int64) % SECTORS
    met = np.zeros((len(proposed), SECTORS), np.bool_)
    rows = np.broadcast_to(np.arange(len(proposed))[:, None], sector.shape)
    met[rows[continues], sector[continues]] = True
    return np.stack([distance, agreement, (1 + met.mean(axis=1)) / 2], axis=1)
