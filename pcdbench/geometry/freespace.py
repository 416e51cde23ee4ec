"""Free space: where a person can stand and walk in a scene, and smooth paths through it.

A grid seen from above. A cell is occupied where anything lies between ankle and head height, free where a body fits
around it, the floor was seen, and one can walk there from the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.graph import MCP_Geometric

from pcdbench.errors import Skipped

CELL_M = 0.05
BODY_RADIUS_M = 0.25
ANKLE_M, HEAD_M = 0.1, 1.8
FLOOR_REACH_M = 0.4
SHORTEST_LEG_M = 0.5
# A floor of 300 x 300 m has as many; distances over more would take gigabytes.
_MOST_CELLS = 40_000_000


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """The free cells of a scene.

    Attributes:
        corner: (2,) metres, x and y of the grid's lower corner.
        free: (X, Y) mask of cells of 5 cm where a body of radius 0.25 m can stand.
        clearance_m: (X, Y) least horizontal distance, from anywhere in a cell, to what is occupied; inf in all cells
            where nothing is.
        floor_m: height of the floor.
    """

    corner: NDArray[np.float64]
    free: NDArray[np.bool_]
    clearance_m: NDArray[np.float64]
    floor_m: float

    @cached_property
    def centers(self) -> NDArray[np.float64]:
        """(F, 2) metres: the centres of the free cells."""
        return self.corner + (np.argwhere(self.free) + 0.5) * CELL_M

    def nearest(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """(2,) metres: the centre of the free cell nearest to `xy` (2,)."""
        return self.centers[np.argmin(np.linalg.norm(self.centers - xy, axis=1))]

    def clearance_at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) clearance of the cells that (N, 2) positions fall into; 0 outside the grid."""
        cells = np.floor((xy - self.corner) / CELL_M).astype(np.int64)
        inside = ((cells >= 0) & (cells < self.free.shape)).all(axis=1)
        result = np.zeros(len(xy))
        result[inside] = self.clearance_m[tuple(cells[inside].T)]
        return result

    def walk(self, length_m: float, step_m: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """(N, 2) positions, `step_m` apart along a smooth walk of at least `length_m` between random free cells.

        Each leg goes to a random free cell at least a metre off (or the farthest there is) by the way of least
        cost, which keeps to the middle of the free space; corners are rounded where the room allows it.

        Raises:
            Skipped: where the free space is less than half a metre across.
        """
        cost = np.where(self.free, 1.0 + 0.1 / np.maximum(self.clearance_m - BODY_RADIUS_M + CELL_M, CELL_M), np.inf)
        cells = np.argwhere(self.free)
        here = cells[rng.integers(len(cells))]
        way, length = [here[None]], 0.0
        while length < length_m:
            far = cells[np.linalg.norm(cells - here, axis=1) * CELL_M >= 1.0]
            target = far[rng.integers(len(far))] if len(far) else cells[_farthest(cells, here)]
            if np.linalg.norm(target - here) * CELL_M < SHORTEST_LEG_M:
                raise Skipped("the free space is less than half a metre across; there is nowhere to walk")
            router = MCP_Geometric(cost, fully_connected=True)
            router.find_costs([tuple(here)], [tuple(target)])
            leg = np.array(router.traceback(tuple(target)))[1:]
            way.append(leg)
            length += float(np.linalg.norm(np.diff(np.vstack([here, leg]), axis=0), axis=1).sum()) * CELL_M
            here = target
        raw = self.corner + (np.concatenate(way) + 0.5) * CELL_M
        return _resampled(self._smoothed(_resampled(raw, 0.01)), step_m)

    def _smoothed(self, path: NDArray[np.float64]) -> NDArray[np.float64]:
        """The path (N, 2), 1 cm apart, smoothed as much as the clearance allows."""
        for width_m in (0.4, 0.2, 0.1):
            smooth = ndimage.gaussian_filter1d(path, width_m / 0.01, axis=0, mode="nearest")
            if (self.clearance_at(smooth) >= BODY_RADIUS_M).all():
                return smooth
        return path


def headings(path: NDArray[np.float64], lookahead: int = 8) -> NDArray[np.float64]:
    """(N,) radians: at each position of a path (N, 2), the direction of the one `lookahead` positions on."""
    ahead = path[np.minimum(np.arange(len(path)) + lookahead, len(path) - 1)] - path
    moving = np.linalg.norm(ahead, axis=1) > 1e-6
    last = np.maximum.accumulate(np.where(moving, np.arange(len(path)), 0))
    return np.arctan2(ahead[last, 1], ahead[last, 0])


def free_space(obstacles: NDArray[np.float64], seen: NDArray[np.float64]) -> FreeSpace:
    """The free space of a scene, its largest connected part.

    Args:
        obstacles: (N, 3) points on every surface, no farther apart than a cell where they are known well.
        seen: (M, 3) points of the scan: its floor is the only floor one can stand on.

    Raises:
        Skipped: where there is none, or the scan is far larger than a building's floor.
    """
    sides_m = np.ptp(seen, axis=0)
    if sides_m[0] * sides_m[1] > _MOST_CELLS * CELL_M**2 or sides_m[2] > _MOST_CELLS * CELL_M:
        size = " x ".join(f"{side:.4g}" for side in sides_m)
        raise Skipped(
            f"the scan is {size} m, too large to look for free space in; cut it, or check that it is in metres"
        )
    floor = floor_height(seen)
    corner = seen[:, :2].min(axis=0) - CELL_M
    shape = tuple(np.ceil((seen[:, :2].max(axis=0) - corner) / CELL_M).astype(int) + 2)
    height = obstacles[:, 2] - floor
    occupied = _cells(obstacles[(height > ANKLE_M) & (height < HEAD_M)], corner, shape)
    # Less a cell's diagonal, half of it at each end: an obstacle may lie anywhere in its cell, a position in its own.
    clearance = ndimage.distance_transform_edt(~occupied) * CELL_M - np.sqrt(2) * CELL_M
    if not occupied.any():
        clearance = np.full(shape, np.inf)
    floor_seen = _cells(seen[np.abs(seen[:, 2] - floor) <= ANKLE_M], corner, shape)
    on_floor = ndimage.distance_transform_edt(~floor_seen) * CELL_M <= FLOOR_REACH_M
    border = np.zeros(shape, bool)
    border[1:-1, 1:-1] = True
    parts, count = ndimage.label((clearance >= BODY_RADIUS_M) & on_floor & border & floor_seen.any())
    if not count:
        raise Skipped("there is no free space to stand in: no part of the floor has 0.25 m around it")
    largest = 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
    return FreeSpace(corner, parts == largest, np.maximum(clearance, 0.0), floor)


def floor_height(points: NDArray[np.float64]) -> float:
    """Height (metres) of the fullest 5 cm layer in the lowest third of a scan."""
    z = points[:, 2]
    low, high = np.percentile(z, [0.1, 99.9])
    edges = np.arange(low - 0.05, low + max((high - low) / 3, 0.1) + 0.05, 0.05)
    counts, _ = np.histogram(z, edges)
    fullest = int(np.argmax(counts))
    layer = z[(z >= edges[fullest] - 0.025) & (z < edges[fullest + 1] + 0.025)]
    return float(np.median(layer))


def points_on_triangles(corners: NDArray[np.float64], spacing_m: float = 0.8 * CELL_M) -> NDArray[np.float64]:
    """(N, 3) points on triangles (T, 3, 3), none of which is farther than `spacing_m` from the next.

    Rows parallel to the longest side, up to the opposite corner; long thin triangles take few.
    """
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    longest = lengths.argmax(axis=1)
    turned = np.take_along_axis(corners, ((longest[:, None] + np.arange(3)) % 3)[..., None], axis=1)
    start, base, side = turned[:, 0], turned[:, 1] - turned[:, 0], turned[:, 2] - turned[:, 0]
    length = np.maximum(lengths.max(axis=1), 1e-12)
    altitude = np.linalg.norm(np.cross(base, side), axis=1) / length
    columns = np.ceil(length / spacing_m).astype(np.int64) + 1
    rows = np.ceil(altitude / spacing_m).astype(np.int64) + 1
    count = columns * rows
    triangle = np.repeat(np.arange(len(corners)), count)
    within = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
    up = (within // columns[triangle]) / np.maximum(rows - 1, 1)[triangle]
    along = (within % columns[triangle]) / np.maximum(columns - 1, 1)[triangle] * (1 - up)
    return start[triangle] + along[:, None] * base[triangle] + up[:, None] * side[triangle]


def _cells(points: NDArray[np.float64], corner: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mask (X, Y) of the cells with points in them."""
    cells = np.floor((points[:, :2] - corner) / CELL_M).astype(np.int64)
    cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
    mask = np.zeros(shape, bool)
    mask[tuple(cells.T)] = True
    return mask


def _farthest(cells: NDArray[np.int64], here: NDArray[np.int64]) -> int:
    return int(np.argmax(np.linalg.norm(cells - here, axis=1)))


def _resampled(path: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    """The polyline (N, 2) as points `step_m` apart along it, from its start."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.arange(0.0, lengths[-1] + 1e-9, step_m)
    return np.stack([np.interp(at, lengths, path[:, axis]) for axis in range(2)], axis=1)
