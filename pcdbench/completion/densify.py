"""New surface at the density of what was observed around it: proposed points, thinned or filled up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.completion.surface import RADIUS_OF_SPACING, tangents
from pcdbench.geometry.sampling import apart_indices
from pcdbench.threads import thread_count

MOST_ROUNDS = 8
# A round that adds less than this share of the points of its class is its last.
FEWEST_NEW = 0.03
# Of the points that the proposed surface has room for at the density wanted.
ENOUGH = 0.97
# Radius of the disks, in spacings of the proposed points: nine in ten places among random ones are on one.
DISK = 0.8
# Where the proposed points are nearly as dense as they shall be, they are only thinned.
DENSE_ENOUGH = 0.85
_CLASSES_AN_OCTAVE = 4


def at_density(
    proposed: NDArray[np.float64],
    normals: NDArray[np.float64],
    proposed_spacing_m: NDArray[np.float64],
    spacing_m: NDArray[np.float64],
    observed: cKDTree,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(M, 3) points on the proposed surface, no nearer to an observed point than to each other, and (M,) their spacing.

    Dart throwing, first at the proposed points themselves, then, in rounds, at random places on disks around them
    in their planes; until there are as many as the surface has room for, or a round adds little. Points of
    different density are thrown class by class, the widest spacing first.

    Args:
        proposed: (K, 3) metres, near the origin.
        normals: (K, 3) of the surface there.
        proposed_spacing_m: (K,) how far the proposed points are apart.
        spacing_m: (K,) how far points shall be apart there, as on a square grid.
        observed: tree of all observed points around.
        rng: decides the throws.
    """
    if not len(proposed):
        return np.empty((0, 3)), np.empty(0)
    first, second = tangents(normals)
    classes = np.round(_CLASSES_AN_OCTAVE * np.log2(spacing_m)).astype(np.int64)
    taken, spacings = np.empty((0, 3)), np.empty(0)
    for number in np.unique(classes)[::-1]:
        of_class = np.flatnonzero(classes == number)
        spacing = float(np.median(spacing_m[of_class]))
        radius = RADIUS_OF_SPACING * spacing
        before = len(taken)
        candidates = proposed[of_class]
        sparse = of_class[spacing_m[of_class] < DENSE_ENOUGH * proposed_spacing_m[of_class]]
        wanted = (proposed_spacing_m[sparse] ** 2).sum() / spacing**2
        for _ in range(MOST_ROUNDS):
            gap, _ = observed.query(candidates, distance_upper_bound=radius, workers=thread_count())
            both = np.concatenate([taken, candidates[gap >= radius]])
            kept = apart_indices(both, radius, rng, fixed=len(taken))
            new = len(kept) - len(taken)
            taken = both[kept]
            if new < FEWEST_NEW * (len(taken) - before) or len(taken) - before >= ENOUGH * wanted:
                break
            source = rng.choice(sparse, int(1.5 * wanted) + 8)
            reach = DISK * proposed_spacing_m[source] * np.sqrt(rng.random(len(source)))
            angle = rng.uniform(0, 2 * np.pi, len(source))
            candidates = (
                proposed[source]
                + first[source] * (reach * np.cos(angle))[:, None]
                + second[source] * (reach * np.sin(angle))[:, None]
            )
        spacings = np.concatenate([spacings, np.full(len(taken) - before, spacing)])
    return taken, spacings
