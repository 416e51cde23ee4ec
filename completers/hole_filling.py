"""The completer `hole_filling`: near neighbours make a mesh, its holes are closed; the input is kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

import pcdbench
from pcdbench import Completer, PointCloud
from pcdbench.geometry.sampling import apart_indices, poisson_disk_indices

from .inpainting import inpainted_colors
from .local_surface import surface_spacing, unoriented_normals
from .triangulation import hole_triangles

MAX_MESH_POINTS = 60_000
CANDIDATES_PER_POINT = 5
MAX_CANDIDATES = 500_000
FEWEST_POINTS = 20
# Random sequential packing covers 0.547 of a surface with disks of this diameter: one point per spacing squared.
DART_RADIUS = 0.835


class HoleFillingOptions(pcdbench.Options):
    """Options of `hole_filling`."""

    max_edge_m: float = Field(2.5, gt=0, description="longest edge of a triangle that may close a hole, metres")
    link: float = Field(
        2.8, gt=1, description="points closer than this many typical spacings are joined; longer edges span a hole"
    )
    min_gap_deg: float = Field(
        110.0, gt=0, lt=360, description="a point is on a rim if its neighbours leave a sector this wide free"
    )
    min_cosine: float = Field(
        0.8,
        ge=0,
        le=1,
        description="cosine of the most that a triangle may turn from the normal at its corners, "
        "unless half of the points around a corner lie in its plane",
    )
    emptiness: float = Field(
        0.9, gt=0, le=1, description="share of a triangle's smallest ball, by radius, that must hold no point"
    )
    max_open: float = Field(
        0.65, ge=0, le=1, description="share of a closed hole's border, by length, that may lack a rim"
    )


class HoleFilling(Completer):
    """Closes the holes of the mesh of near neighbours with large triangles, and samples those at the input's density.

    The mesh is taken from the Delaunay tetrahedra of the cloud. Triangles with a long edge between rim points are
    the holes, where they go on in the plane of the surface and have enough rim around them: two surfaces that face
    each other are not joined. New points lie not on the triangles but on the surface that the normals at their
    corners suggest (Phong tessellation, Boubekeur and Alexa 2008, with the factor 1/2 that is exact for paraboloids).
    """

    Options = HoleFillingOptions
    options: HoleFillingOptions
    version = "2"
    citation = "Boubekeur and Alexa, Phong Tessellation, ACM Trans. Graphics 27(5), 2008"

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """The cloud and, after it, the points that close its holes; a cloud without a surface is returned as it is."""
        center = cloud.points.mean(axis=0)
        points = cloud.points - center
        if len(points) < FEWEST_POINTS:
            return cloud
        chosen = poisson_disk_indices(points, MAX_MESH_POINTS, rng)
        corners = points[chosen]
        spacing = surface_spacing(corners)
        if spacing == 0:
            return cloud
        normals = unoriented_normals(corners)
        triangles, corner_normals = hole_triangles(
            corners,
            normals,
            link_m=self.options.link * spacing,
            max_edge_m=self.options.max_edge_m,
            min_gap_deg=self.options.min_gap_deg,
            min_cosine=self.options.min_cosine,
            emptiness=self.options.emptiness,
            max_open=self.options.max_open,
            rng=rng,
        )
        if not len(triangles):
            return cloud
        if len(points) > len(corners):
            spacing = surface_spacing(points)
        candidates = _surface_points(corners[triangles], corner_normals, spacing, rng)
        # Thrown around the observed points, so that nothing is put where the surface, or another one, is known.
        taken = apart_indices(np.concatenate([points, candidates]), DART_RADIUS * spacing, rng, fixed=len(points))
        new_points = candidates[taken[len(points) :] - len(points)]
        colors = None if cloud.colors is None else inpainted_colors(new_points, points, cloud.colors)
        return PointCloud.concatenate([cloud, PointCloud(new_points + center, colors)])


def _surface_points(
    corners: NDArray[np.float64], normals: NDArray[np.float64], spacing: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """(M, 3) random points, denser than the cloud, on the curved surface over (T, 3, 3) corners with normals."""
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    count = int(min(CANDIDATES_PER_POINT * (1 + areas.sum() / spacing**2), MAX_CANDIDATES))
    chosen = rng.choice(len(areas), count, p=areas / areas.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    corners, normals = corners[chosen], normals[chosen]
    flat = np.einsum("nk,nki->ni", weights, corners)
    heights = np.einsum("nki,nki->nk", corners - flat[:, None], normals)
    return flat + 0.5 * np.einsum("nk,nk,nki->ni", weights, heights, normals)
