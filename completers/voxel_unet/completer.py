"""voxel_unet: keeps every observed point and adds points where the network finds surface that nobody saw."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial import cKDTree

import pcdbench
from pcdbench.geometry.neighbors import loose_tree
from pcdbench.threads import thread_count
from pcdbench.weights import LearnedCompleter

from ..heading import RoomFrame, wall_heading
from ..inpainting import colors_around
from ..local_surface import spread_evenly, surface_spacing
from ..prism import BEYOND
from .grid import Grid
from .tiles import Prediction, predict

if TYPE_CHECKING:
    from .network import VoxelUNet

SHIPPED_WEIGHTS = Path(__file__).with_name("weights.safetensors")
VOXEL_SPACINGS = 1.75  # the edge of a voxel, in spacings of the surface: two median nearest-neighbour distances
FEWEST_POINTS = 30  # fewer say nothing about a surface: they are returned as they are
NEIGHBORS = 10
JITTERS = 4  # candidates a sub-voxel: what blue noise chooses from
UNOBSERVED = 0.9  # spacings from any observed point from which on nothing was observed
LEAST_LIKELY = 0.05  # what is less likely is empty space, most of it, and says nothing of how much is missing
# Unobserved surface over observed, both in sub-voxels, at which the network's probabilities come out right (on `val`).
USUAL_SHARE = 0.6
MAX_SHIFT = 3.0  # by what odds are multiplied, or divided, at most: one small hole in a whole room is a hole, too
# Darts keep apart by the square root of this, in spacings: with so many candidates a floor gets its own density back
# (measured: within 3 %). With more candidates darts could keep farther apart, at more cost.
DISK_AREAS = 0.44


class VoxelUNetCompleter(LearnedCompleter):
    """Volumetric inpainting by a 3D U-Net over voxels of 1.75 spacings of the cloud's surface.

    Every observed point is kept. Where nothing was observed and the probability of surface passes the
    threshold, points are added on the predicted surface, at the observed density.
    """

    class Options(pcdbench.Options):
        threshold: float = Field(0.35, gt=0, lt=1, description="probability above which surface is added")
        weights: str = Field(
            "", description="a safetensors file of one's own, or PROTOCOL://...#sha256=DIGEST; empty for the package's"
        )

    options: Options
    version = "8"
    trainee = "pcdbench_completers.voxel_unet.trainee:VoxelUNetTrainee"

    def __init__(
        self,
        options: Options | None = None,
        network: VoxelUNet | None = None,
        voxel_spacings: float = VOXEL_SPACINGS,
    ) -> None:
        """Load the weights, or use a network that is there already (in training)."""
        super().__init__(options)
        self._voxel_spacings = voxel_spacings
        from .network import VoxelUNet, for_inference

        network = network or self.trained(VoxelUNet(), SHIPPED_WEIGHTS, self.options.weights, "voxel_unet")
        self._network = for_inference(network)

    def complete(self, cloud: pcdbench.PointCloud, rng: np.random.Generator) -> pcdbench.PointCloud:
        return self.complete_with_confidence(cloud, rng)[0]

    def complete_with_confidence(
        self, cloud: pcdbench.PointCloud, rng: np.random.Generator
    ) -> tuple[pcdbench.PointCloud, NDArray[np.floating[Any]]]:
        """The completed cloud, and the probability of surface at each added point (1 at the observed ones)."""
        origin = cloud.points.mean(axis=0)
        centered = cloud.points - origin
        tree = loose_tree(centered)
        spacing_m = surface_spacing(centered, tree) if len(cloud) >= FEWEST_POINTS else 0.0
        if spacing_m == 0.0:
            return cloud, np.ones(len(cloud), np.float32)
        frame = RoomFrame(origin, wall_heading(centered, tree))
        local = frame.laid(cloud)
        grid = Grid.around(local.points, self._voxel_spacings * spacing_m)
        threshold = self.options.threshold
        may_pass = threshold / (threshold + MAX_SHIFT * (1 - threshold))
        found = predict(self._network, local, grid, min(LEAST_LIKELY, may_pass), BEYOND * spacing_m)
        tree = loose_tree(local.points)
        found = given_what_is_missing(unobserved(found, tree, grid, spacing_m), local, grid)
        found = found.select(found.probability > threshold)
        added, confidence = surface_points(local, tree, found, spacing_m, rng)
        both = np.concatenate([np.ones(len(cloud), np.float32), confidence])
        return pcdbench.PointCloud.concatenate([cloud, frame.back(added)]), both


def unobserved(found: Prediction, tree: cKDTree, grid: Grid, spacing_m: float) -> Prediction:
    """The part of a prediction that lies where nothing was observed, and among what was: not outside of the prism.

    Args:
        tree: of the observed points.
    """
    found = found.select(grid.prism.depth(found.points) > -BEYOND * spacing_m)
    away, _ = tree.query(found.points, distance_upper_bound=UNOBSERVED * spacing_m, workers=thread_count())
    return found.select(np.isinf(away))


def given_what_is_missing(found: Prediction, cloud: pcdbench.PointCloud, grid: Grid) -> Prediction:
    """The probabilities of a cloud's unobserved surface, once it is known how much of this cloud is missing.

    What the network says is right on the average over clouds of which little or much was missing: too much where it
    is little, too little where it is much. How much is missing shows in the sum of all that it says, over what was
    observed; odds are multiplied by that share over the usual one. This is a step of the adjustment to new prior
    probabilities of Saerens, Latinne and Decaestecker (Neural Computation 14, 2002).
    """
    observed = len(np.unique(grid.cells(cloud.points, per_edge=2)[0]))
    missing = float(found.probability[found.probability > LEAST_LIKELY].sum()) / observed
    factor = np.float32(np.clip(missing / USUAL_SHARE, 1 / MAX_SHIFT, MAX_SHIFT))
    odds = found.probability * factor
    return replace(found, probability=odds / (odds + 1 - found.probability))


def surface_points(
    cloud: pcdbench.PointCloud, tree: cKDTree, found: Prediction, spacing_m: float, rng: np.random.Generator
) -> tuple[pcdbench.PointCloud, NDArray[np.float32]]:
    """Points on the predicted surface, as dense as the observed ones and apart from them.

    Args:
        cloud: what was observed, near the origin.
        tree: of its points.

    Returns:
        The M added points, and the (M,) probability of the sub-voxels they came from.
    """
    added, source = spread_evenly(
        found.points,
        cloud.points,
        spacing_m,
        float(np.sqrt(DISK_AREAS)),
        rng,
        neighbors=NEIGHBORS,
        jitters=JITTERS,
        tree=tree,
    )
    if cloud.colors is None:
        return pcdbench.PointCloud(added), found.probability[source]
    colors = colors_around(added, cloud.points, cloud.colors, spacing_m, found.colors[source], tree)
    return pcdbench.PointCloud(added, colors), found.probability[source]
