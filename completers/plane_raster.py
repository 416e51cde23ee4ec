"""A plane as a grid of cells: where its points are, where its gaps are, and where other planes cut it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from .planes import Plane

DIRECTIONS = 16
MAX_CELLS = 1_000_000
CLOSING_CELLS = 2.0
HEADING_LIMIT = 0.9


@dataclass(frozen=True, eq=False)
class PlaneRaster:
    """A plane cut into square cells around its points.

    Attributes:
        plane: the plane.
        axes: (2, 3) unit vectors in the plane: the grid's rows and columns.
        origin: (2,) metres along the axes: the corner of cell (0, 0).
        cell_m: edge of a cell, metres.
        covered: (R, C) mask of the cells that hold the plane's points or lie between them.
        away_m: (R, C) metres to the nearest covered cell.
    """

    plane: Plane
    axes: NDArray[np.float64]
    origin: NDArray[np.float64]
    cell_m: float
    covered: NDArray[np.bool_]
    away_m: NDArray[np.float64]

    @classmethod
    def around(
        cls,
        plane: Plane,
        points: NDArray[np.float64],
        cell_m: float,
        margin_m: float,
        heading: NDArray[np.float64],
    ) -> PlaneRaster:
        """The raster of a plane of (N, 3) `points` and `margin_m` around it; huge planes get larger cells.

        Args:
            heading: (3,) horizontal direction that grids on floors and ceilings follow.
        """
        axes = _axes(plane.normal, heading)
        flat = points[plane.inliers] @ axes.T
        low, high = flat.min(axis=0) - margin_m, flat.max(axis=0) + margin_m
        cell_m = max(cell_m, float(np.sqrt(np.prod(high - low) / MAX_CELLS)))
        occupied = np.zeros(tuple(np.ceil((high - low) / cell_m).astype(int) + 1), dtype=bool)
        occupied[tuple(np.floor((flat - low) / cell_m).astype(int).T)] = True
        # A morphological closing by disks: the cells between neighbouring points are no gaps.
        grown = distance_transform_edt(~occupied) <= CLOSING_CELLS
        covered = occupied | (distance_transform_edt(grown) > CLOSING_CELLS)
        return cls(plane, axes, low, cell_m, covered, distance_transform_edt(~covered) * cell_m)

    def places(self, cells: NDArray[np.int64], within: NDArray[np.float64] | float = 0.5) -> NDArray[np.float64]:
        """(M, 3) points on the plane in the (M, 2) cells: at `within` (shares of a cell), by default the centre."""
        return ((cells + within) * self.cell_m + self.origin) @ self.axes + self.plane.normal * self.plane.offset

    def distance_to_points(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """(M,) metres, along the plane, from (M, 3) places to the plane's points; infinite outside the raster."""
        cells = np.floor((places @ self.axes.T - self.origin) / self.cell_m).astype(np.int64)
        inside = ((cells >= 0) & (cells < self.covered.shape)).all(axis=1)
        result = np.full(len(places), np.inf)
        result[inside] = self.away_m[tuple(cells[inside].T)]
        return result

    def gaps(
        self,
        others: list[PlaneRaster],
        points: NDArray[np.float64],
        *,
        reach_m: float,
        support_m: float,
        min_enclosed: float,
        min_own: float,
        one_side: float,
    ) -> NDArray[np.int64]:
        """(M, 2) cells that the plane's surface, as far as one can tell, once covered.

        Rays go from a cell along the plane in 16 directions, `reach_m` far, up to the plane's points or up to
        where another plane cuts this one. A cell is in a gap if enough of them meet either and enough meet the
        plane's own points, so that gaps at the edges of a room are filled up to the next wall and not beyond.

        Args:
            others: the other planes' rasters.
            points: (N, 3) the cloud.
            support_m: another plane cuts this one only within this distance of its own points.
            min_enclosed: least share of the rays that meet anything.
            min_own: least share of the rays that meet the plane's own points.
            one_side: a plane with this share of its points on one side of another one ends there.
        """
        cells = np.argwhere(self.away_m <= reach_m)
        places = self.places(cells)
        inliers = points[self.plane.inliers]
        cut = np.zeros(len(cells), dtype=bool)
        beyond = np.zeros(len(cells), dtype=bool)
        for other in others:
            normal, offset = other.plane.normal, other.plane.offset
            if abs(normal @ self.plane.normal) > 0.7:
                continue
            height = places @ normal - offset
            side = inliers @ normal - offset
            for sign in (1, -1):
                if (sign * side > -self.cell_m).mean() > one_side:
                    beyond |= sign * height < -self.cell_m
            near = np.flatnonzero(np.abs(height) <= 0.8 * self.cell_m)
            cut[near[other.distance_to_points(places[near]) <= support_m]] = True
        walls = np.zeros_like(self.covered)
        walls[tuple(cells[cut].T)] = True
        enclosed, own = _ray_counts(self.covered, walls & ~self.covered, int(np.ceil(reach_m / self.cell_m)))
        at = tuple(cells.T)
        enough = (enclosed[at] >= min_enclosed * DIRECTIONS) & (own[at] >= min_own * DIRECTIONS)
        return cells[enough & ~beyond & ~self.covered[at]]


def _axes(normal: NDArray[np.float64], heading: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, 3) unit vectors in the plane: upright on walls, along `heading` on floors."""
    guide = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < HEADING_LIMIT else heading
    second = guide - normal * (guide @ normal)
    second /= np.linalg.norm(second)
    return np.stack([np.cross(second, normal), second])


def _ray_counts(
    covered: NDArray[np.bool_], walls: NDArray[np.bool_], steps: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Of the rays from each cell, `steps` cells long, how many meet anything, and how many meet `covered` first.

    The masks are shifted by strides that double: after k shifts a cell knows of 2^k cells along the ray.
    """
    anything = np.zeros(covered.shape, np.uint8)
    own = np.zeros(covered.shape, np.uint8)
    for angle in np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS):
        seen, blocked = covered, walls
        known = 1
        while known <= steps:
            stride = min(known, steps + 1 - known)
            by = round(stride * np.cos(angle)), round(stride * np.sin(angle))
            seen, blocked = (
                seen | (_shifted(seen, *by) & ~blocked),
                blocked | (_shifted(blocked, *by) & ~seen),
            )
            known += stride
        own += seen
        anything += seen | blocked
    return anything, own


def _shifted(mask: NDArray[np.bool_], rows: int, columns: int) -> NDArray[np.bool_]:
    """The mask moved by so many cells; what comes in is False."""
    result = np.zeros_like(mask)
    (to_rows, from_rows), (to_columns, from_columns) = (
        (slice(by, None), slice(None, size - by)) if by >= 0 else (slice(None, max(size + by, 0)), slice(-by, None))
        for by, size in zip((rows, columns), mask.shape, strict=True)
    )
    if abs(rows) < mask.shape[0] and abs(columns) < mask.shape[1]:
        result[to_rows, to_columns] = mask[from_rows, from_columns]
    return result
