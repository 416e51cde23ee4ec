"""What completers share that learned to complete patches: cutting, asking a network, merging with what was observed."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

import pcdbench
from pcdbench.geometry.neighbors import loose_tree, nearest
from pcdbench.options import changed
from pcdbench.threads import thread_count
from pcdbench.weights import LearnedCompleter

from .heading import RoomFrame
from .inpainting import colors_around
from .local_surface import spread_evenly, surface_spacing, unoriented_normals
from .patches import Patches
from .prism import BEYOND, Prism

NEIGHBORS = 10
JITTERS = 4  # candidates a point of the network's, if as dense as the observed ones: what blue noise chooses from
MOST_REACH = 3.0
# A found point counts where so many others within so many spacings lie in its plane, within one spacing of it (those
# that one plane alone leaves behind, off the surface or past its edge, have fewer), and this share of the observed
# points nearest to it, too: then it carries on what was observed.
BESIDE, BESIDE_SPACINGS = 6, 3.0
CARRIED_ON = 0.7
NEAREST = 32  # how many of both are looked at
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
    passes: int = Field(
        1, ge=1, description="with keep_observed: times that the network is asked, each time about all there is by then"
    )
    weights: str = Field(
        "", description="a safetensors file of one's own, or PROTOCOL://...#sha256=DIGEST; empty for the package's"
    )

    @model_validator(mode="after")
    def _merging_is_used(self) -> Self:
        if self.passes > 1 and not self.keep_observed:
            raise ValueError("a second pass goes on from what the first one added; add keep_observed=true, or passes=1")
        if changed(self, "clearance_spacings") and not self.keep_observed:
            raise ValueError("clearance_spacings says where nothing was observed; add keep_observed=true, or leave it")
        return self


class PatchwiseCompleter(LearnedCompleter):
    """Cuts the cloud into patches, has a network complete them and puts the patches together again.

    The room is turned until its walls lie along the axes, and what is found is turned back: so a room is cut and
    completed alike, however its scan is turned.
    """

    Options: ClassVar[type[pcdbench.Options]] = PatchwiseOptions
    options: PatchwiseOptions

    def complete(self, cloud: pcdbench.PointCloud, rng: np.random.Generator) -> pcdbench.PointCloud:
        frame = RoomFrame.of(cloud.points)
        for _ in range(self.options.passes):
            room = frame.laid(cloud)
            patches = Patches.of(room.points, self.options.grid, rng)
            if patches is None:
                return cloud
            keep = self.options.keep_observed
            found = frame.back(self.found(room.without_colors() if keep and not self.paints else room, patches, rng))
            if not keep:
                return found
            cloud = merged(cloud, found, self.options.clearance_spacings, rng)
        return cloud

    @property
    def paints(self) -> bool:
        """Whether what is found has colours of its own; else merging continues the observed ones."""
        return False

    @abstractmethod
    def found(self, cloud: pcdbench.PointCloud, patches: Patches, rng: np.random.Generator) -> pcdbench.PointCloud:
        """The network's own cloud, in metres, coloured where the given one is; walls lie along the axes."""


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


def _supported(
    points: NDArray[np.float64], which: NDArray[np.int64], observed: NDArray[np.float64], spacing_m: float
) -> NDArray[np.bool_]:
    """(W,) whether enough found points beside each of these (W,) rows of (N, 3) found ones lie in its plane, and enough
    of the (M, 3) observed ones nearest to it.
    """
    at = points[which]
    normals = unoriented_normals(points, at=at)

    def in_plane(those: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        off = those[np.minimum(rows, len(those) - 1)] - at[:, None]
        return np.abs(np.einsum("nki,ni->nk", off, normals)) < spacing_m

    distances, others = loose_tree(points).query(
        at,
        k=min(NEAREST + 1, len(points)),
        distance_upper_bound=BESIDE_SPACINGS * spacing_m,
        workers=thread_count(),
    )
    beside = (np.isfinite(distances) & in_plane(points, others))[:, 1:].sum(axis=1)
    _, seen = loose_tree(observed).query(at, k=min(NEAREST, len(observed)), workers=thread_count())
    return (beside >= BESIDE) & (in_plane(observed, seen).mean(axis=1) >= CARRIED_ON)


def merged(
    cloud: pcdbench.PointCloud, found: pcdbench.PointCloud, clearance_spacings: float, rng: np.random.Generator
) -> pcdbench.PointCloud:
    """Every observed point, and found ones among them where nothing was observed, at the observed density.

    What a network puts above or below observed surface is its own error; in a hole it lies beside what was observed.
    So distances are taken along the surface, in the plane of the nearest observed point. Outside of the upright prism
    around what was observed nothing is added: planes go on beyond the walls that end them; nor where a found point has
    hardly others beside it, or lies in a plane of its own. One that is left gives a few candidates, spread over the
    plane that fits its neighbours; blue noise chooses among them. So sparse finds become as dense as the cloud, and
    dense ones no denser.

    Args:
        found: where it has colours, added points have those of the points they came from; else those of the observed
            surface around.
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
    away = away[_supported(points, away, observed, reach * spacing_m)]
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
    if cloud.colors is None:
        colors = None
    elif found.colors is not None:
        colors = found.colors[away[source]]
    else:
        colors = colors_around(added, observed, cloud.colors, spacing_m)
    return pcdbench.PointCloud.concatenate([cloud, pcdbench.PointCloud(added + origin, colors)])
