"""The completer `midpoints`: closes thin gaps by a point half-way between neighbours that lie far apart."""

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from pcdbench import Completer, Options, PointCloud


class Midpoints(Completer):
    """Keeps the cloud and adds the midpoint of every pair of neighbours that are farther apart than usual.

    "Usual" is the median distance from a point to its nearest neighbour.
    """

    class Options(Options):
        """Which pairs get a midpoint."""

        neighbors: int = Field(8, ge=1, description="neighbours of each point that are looked at")
        gap: float = Field(2.0, gt=0, description="pairs farther apart than this many usual distances are joined")

    options: Options
    version = "1"
    citation = "pcdbench's example plugin"

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """The cloud and its midpoints, coloured half-way."""
        k = min(self.options.neighbors, len(cloud) - 1)
        if k < 1:
            return cloud
        # Centred, so that map coordinates cost no precision.
        centered = cloud.points - cloud.points.mean(axis=0)
        distances, neighbors = cKDTree(centered).query(centered, k=k + 1)
        far = distances[:, 1:] > self.options.gap * np.median(distances[:, 1])
        one = np.repeat(np.arange(len(cloud)), k)[far.ravel()]
        other = neighbors[:, 1:].ravel()[far.ravel()]
        pairs = np.unique(np.sort(np.stack([one, other], axis=1), axis=1), axis=0)
        between = cloud.points[pairs].mean(axis=1)
        colors = None if cloud.colors is None else cloud.colors[pairs].mean(axis=1)
        return PointCloud.concatenate([cloud, PointCloud(between, colors)])
