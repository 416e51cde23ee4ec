"""What completers share that learned to complete patches: cutting, asking a network, merging with what was observed."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

import pcdbench
from pcdbench.geometry.neighbors import loose_tree, nearest
from pcdbench.threads import thread_count
from pcdbench.weights import LearnedCompleter

from .local_surface import spread_evenly, surface_spacing, unoriented_normals
from .patches import Patches
from .prism import BEYOND, Prism

NEIGHBORS = 10
JITTERS = 4  # candidates a point of the network's, if as dense as the observed ones: what blue noise chooses from
MOST_REACH = 3.0
# A found point counts where so many others within so many spacings lie in its plane (within one spacing): those that
# one plane alone leaves behind, off the surface or past its edge, have fewer.
BESIDE, BESIDE_SPACINGS, BESIDE_OF = 2, 3.0, 32
PRISM_CELL = 3.5  # spacings: what has no neighbours within it is a stray
# Dart throwing with this share of the spacing gives a thinned Poisson-disk cloud its own number of points back.
DARTS_PER_SPACING = 0.74


class PatchwiseOptions(pcdbench.Options):
    """Options of all patchwise completers."""

    grid: int = Field(5, ge=1, le=16, description="cells along length and along width")
    keep_observed: bool = Field(
        False, description="keep every observed point, and the network's only where nothing was observed"
    )
    clearance_spacings: float = Field(
        3.0, gt=0, description="with keep_observed: this far along the observed surface nothing was observed"
    )
    weights: str = Field(
        "", description="a safetensors file of one's own, or PROTOCOL://...#sha256=DIGEST; empty for the package's"
    )


class PatchwiseCompleter(LearnedCompleter):
    """Cuts the cloud into patches, has a network complete them and puts the patches together again."""

    Options: ClassVar[type[pcdbench.Options]] = PatchwiseOptions
    options: PatchwiseOptions

    def complete(self, cloud: pcdbench.PointCloud, rng: np.random.Generator) -> pcdbench.PointCloud:
        patches = Patches.of(cloud.points, self.options.grid, rng)
        if patches is None:
            return cloud
        found = self.found(cloud, patches, rng)
        if not self.options.keep_observed:
            return found
        return merged(cloud, found, self.options.clearance_spacings, rng)

    @abstractmethod
    def found(self, cloud: pcdbench.PointCloud, patches: Patches, rng: np.random.Generator) -> pcdbench.PointCloud:
        """The network's own cloud, in metres, coloured where the given one is."""


class LonePatchCompleter(PatchwiseCompleter):
    """Completes each patch on its own; points have the colour of the nearest observed one."""

    def found(self, cloud: pcdbench.PointCloud, patches: Patches, rng: np.random.Generator) -> pcdbench.PointCloud:
        import torch

        from pcdbench.training.precision import bfloat16_pays

        torch.set_num_threads(thread_count())
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=bfloat16_pays()):
            points = patches.metric(self.completed(patches, rng))
        colors = None if cloud.colors is None else cloud.colors[nearest(points, cloud.points)[1]]
        return pcdbench.PointCloud(points, colors)

    @abstractmethod
    def completed(self, patches: Patches, rng: np.random.Generator) -> NDArray[np.float32]:
        """(P, K, 3) the network's points, as patches are scaled; gradients are off."""


def _beside(points: NDArray[np.float64], which: NDArray[np.int64], spacing_m: float) -> NDArray[np.int64]:
    """(W,) how many others are near each of these (W,) rows of (N, 3) points, and lie in its plane."""
    at = points[which]
    distances, rows = loose_tree(points).query(
        at,
        k=min(BESIDE_OF + 1, len(points)),
        distance_upper_bound=BESIDE_SPACINGS * spacing_m,
        workers=thread_count(),
    )
    near = np.isfinite(distances[:, 1:])
    off = points[np.minimum(rows[:, 1:], len(points) - 1)] - at[:, None]
    heights = np.einsum("nki,ni->nk", off, unoriented_normals(points, at=at))
    return (near & (np.abs(heights) < spacing_m)).sum(axis=1)


def merged(
    cloud: pcdbench.PointCloud, found: pcdbench.PointCloud, clearance_spacings: float, rng: np.random.Generator
) -> pcdbench.PointCloud:
    """Every observed point, and found ones among them where nothing was observed, at the observed density.

    What a network puts above or below observed surface is its own error; in a hole it lies beside what was observed.
    So distances are taken along the surface, in the plane of the nearest observed point. Outside of the upright prism
    around what was observed nothing is added: planes go on beyond the walls that end them; nor where a found point has
    hardly others beside it. One that is left gives a few candidates, spread over the plane that fits its neighbours;
    blue noise chooses among them. So sparse finds become as dense as the cloud, and dense ones no denser.

    Args:
        clearance_spacings: how far is far enough, in spacings of the observed points.
    """
    if len(cloud) <= NEIGHBORS:
        return cloud
    origin = cloud.points.mean(axis=0)
    observed, points = cloud.points - origin, found.points - origin
    spacing_m = surface_spacing(observed)
    _, rows = nearest(points, observed)
    off = points - observed[rows]
    normals = unoriented_normals(observed)[rows]
    along = off - np.einsum("ni,ni->n", off, normals)[:, None] * normals
    if spacing_m == 0.0:
        return cloud
    among = Prism.around(observed, PRISM_CELL * spacing_m).depth(points) > -BEYOND * spacing_m
    away = np.flatnonzero(among & (np.linalg.norm(along, axis=1) > clearance_spacings * spacing_m))
    if not len(away):
        return cloud
    # Sparser finds need more candidates, and farther about.
    reach = float(np.clip(surface_spacing(points) / spacing_m, 1.0, MOST_REACH))
    away = away[_beside(points, away, reach * spacing_m) >= BESIDE]
    points = points[away]
    added, source = spread_evenly(
        points,
        observed,
        spacing_m,
        DARTS_PER_SPACING,
        rng,
        neighbors=NEIGHBORS,
        jitters=round(JITTERS * reach**2),
        reach=reach,
    )
    colors = None if found.colors is None else found.colors[away[source]]
    return pcdbench.PointCloud.concatenate([cloud, pcdbench.PointCloud(added + origin, colors)])
