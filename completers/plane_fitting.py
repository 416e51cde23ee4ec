"""The completer `plane_fitting`: planes by RANSAC, the gaps in each filled; the input is kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial import cKDTree

import pcdbench
from pcdbench import Completer, PointCloud
from pcdbench.geometry.sampling import poisson_disk_indices
from pcdbench.threads import thread_count

from .inpainting import inpainted_colors
from .local_surface import surface_spacing, unoriented_normals
from .plane_raster import PlaneRaster
from .planes import Plane, planes

FEWEST_POINTS = 20
MAX_FIT_POINTS = 200_000
CANDIDATES_PER_POINT = 4
WALL_LIMIT = 0.3


class PlaneFittingOptions(pcdbench.Options):
    """Options of `plane_fitting`."""

    distance_m: float = Field(0.03, gt=0, description="a point this close to a plane is on it, metres")
    min_points: int = Field(100, ge=3, description="smallest number of points that make a plane")
    max_planes: int = Field(40, ge=1, description="largest number of planes")
    reach_m: float = Field(2.5, gt=0, description="how far a gap's cells may be from what encloses them, metres")
    support_m: float = Field(2.0, ge=0, description="a plane ends at another one this close to its points, metres")
    min_enclosed: float = Field(0.75, ge=0, le=1, description="share of directions in which a gap is enclosed")
    min_own: float = Field(0.3, ge=0, le=1, description="share of directions that lead from a gap to its own plane")
    one_side: float = Field(
        0.97, gt=0.5, le=1, description="a plane with this share of its points on one side of another ends there"
    )
    clearance: float = Field(
        0.8,
        ge=0,
        le=1,
        description="a new point has no observed point nearer than this share of its distance to its own plane's",
    )


class PlaneFitting(Completer):
    """Finds planes, and on each the gaps that its own points and other planes enclose; fills them at its density.

    What stands in front of a plane hides it: a gap with observed points nearer than the plane's own (behind a
    cupboard, under a table) was no surface that the scan saw, and stays open (`clearance`).
    """

    Options = PlaneFittingOptions
    options: PlaneFittingOptions
    citation = "Schnabel, Wahl and Klein, Efficient RANSAC for Point-Cloud Shape Detection, CGF 26(2), 2007"

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """The cloud and, after it, the points that fill its planes; without planes it is returned as it is."""
        center = cloud.points.mean(axis=0)
        points = cloud.points - center
        if len(points) < FEWEST_POINTS:
            return cloud
        spacing = surface_spacing(points)
        if spacing == 0:
            return cloud
        fit = rng.permutation(len(points))[:MAX_FIT_POINTS]
        found = [
            Plane(plane.normal, plane.offset, fit[plane.inliers])
            for plane in planes(
                points[fit],
                unoriented_normals(points[fit]),
                self.options.distance_m,
                self.options.min_points,
                self.options.max_planes,
                rng,
            )
        ]
        if not found:
            return cloud
        scale = len(points) / len(fit)
        margin = self.options.reach_m + 3 * spacing
        heading = _heading(found)
        rasters = [PlaneRaster.around(plane, points, spacing * scale**0.5, margin, heading) for plane in found]
        tree = cKDTree(points)
        filled = [self._filling(k, rasters, points, tree, spacing, scale, rng) for k in range(len(rasters))]
        new_points = np.concatenate(filled)
        colors = None
        if cloud.colors is not None:
            surface = np.full(len(points), -1)
            for k, plane in enumerate(found):
                surface[plane.inliers] = k
            new_surface = np.repeat(np.arange(len(filled)), [len(part) for part in filled])
            colors = inpainted_colors(new_points, points, cloud.colors, new_surface, surface)
        return PointCloud.concatenate([cloud, PointCloud(new_points + center, colors)])

    def _filling(
        self,
        which: int,
        rasters: list[PlaneRaster],
        points: NDArray[np.float64],
        tree: cKDTree,
        spacing: float,
        scale: float,
        rng: np.random.Generator,
    ) -> NDArray[np.float64]:
        """(M, 3) points that fill one plane's gaps; `scale` is how many points of the cloud one inlier stands for."""
        options, raster = self.options, rasters[which]
        cells = raster.gaps(
            rasters[:which] + rasters[which + 1 :],
            points,
            reach_m=options.reach_m,
            support_m=options.support_m,
            min_enclosed=options.min_enclosed,
            min_own=options.min_own,
            one_side=options.one_side,
        )
        if not len(cells):
            return np.empty((0, 3))
        inliers = raster.plane.inliers
        per_cell = scale * len(inliers) / raster.covered.sum()
        drawn = np.repeat(cells, int(np.ceil(CANDIDATES_PER_POINT * per_cell)), axis=0)
        places = raster.places(drawn, rng.random((len(drawn), 2)))
        places = places[poisson_disk_indices(places, round(per_cell * len(cells)), rng)]
        nearest, _ = tree.query(places, workers=thread_count())
        nearest_own, _ = cKDTree(points[inliers]).query(places, workers=thread_count())
        return places[(nearest >= 0.9 * spacing) & (nearest >= options.clearance * nearest_own)]


def _heading(found: list[Plane]) -> NDArray[np.float64]:
    """(3,) horizontal normal of the largest wall, or the x axis where there is no wall."""
    for plane in found:
        if abs(plane.normal[2]) < WALL_LIMIT:
            return np.array([plane.normal[0], plane.normal[1], 0.0])
    return np.array([1.0, 0.0, 0.0])
