"""A building with its furniture, as an environment: one mesh, tagged objects, free floor, scanner stations."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from pcdbench.datasets.synthetic.arrangements import furnish
from pcdbench.datasets.synthetic.building import Building
from pcdbench.datasets.synthetic.environment import CELL_M, Environment, FreeFloor
from pcdbench.datasets.synthetic.footprints import Footprint
from pcdbench.datasets.synthetic.layouts import SMALL_KINDS
from pcdbench.datasets.synthetic.placement import Placement
from pcdbench.datasets.synthetic.plan import Floats, Plan, contains

STATION_HEIGHT_M = 1.5
STATION_AREA_M2 = 20.0
STATION_CLEARANCE_M = 0.35


def furnished(name: str, plan: Plan, building: Building, rng: np.random.Generator) -> Environment:
    """Furnish every room of a building."""
    placement = Placement(plan, rng)
    for room in plan.rooms:
        furnish(placement, room)
    mesh, pieces, poses = placement.merged(building.mesh)
    objects, object_pieces = placement.tagged()
    floor, number = _free_floor(plan, placement)
    stations = _stations(floor, number, rng)
    return Environment(name, plan.kind, mesh, pieces, poses, objects, object_pieces, building.lights, stations, floor)


def _free_floor(plan: Plan, placement: Placement) -> tuple[FreeFloor, NDArray[np.int32]]:
    """Where one can stand, and the number of the room that each cell is in (-1 none)."""
    low = np.min([room.outline.min(axis=0) for room in plan.rooms], axis=0) - CELL_M
    high = np.max([room.outline.max(axis=0) for room in plan.rooms], axis=0) + CELL_M
    shape = np.ceil((high - low) / CELL_M).astype(int)
    cells = np.argwhere(np.ones(shape, np.bool_))
    centers = low + (cells + 0.5) * CELL_M
    number = np.full(shape, -1, np.int32)
    for k, room in enumerate(plan.rooms):
        near = np.flatnonzero(
            ((centers >= room.outline.min(axis=0)) & (centers <= room.outline.max(axis=0))).all(axis=1)
        )
        inside = near[contains(room.outline, centers[near])]
        number[tuple(cells[inside].T)] = k
    free = number >= 0
    for opening in plan.openings:
        if opening.kind in ("door", "passage"):
            along = (opening.end - opening.start) / opening.width
            x, y = opening.center
            yaw = math.atan2(along[1], along[0])
            doorway = Footprint(x, y, opening.width / 2, 0.25, yaw, 0.0, 2.0)
            if opening.kind == "passage" or opening.swing_deg > 40:
                _fill(free, doorway, low, True)
            if opening.kind == "door":
                turn = yaw + np.radians(opening.swing_deg)
                middle = opening.start + opening.width / 2 * np.array([math.cos(turn), math.sin(turn)])
                leaf = Footprint(middle[0], middle[1], opening.width / 2, 0.05, turn, 0.0, 2.0)
                _fill(free, leaf, low, False)
    for footprint in placement.solid:
        if footprint.z0 < 1.9:
            _fill(free, footprint, low, False)
    clearance = np.where(free, distance_transform_edt(free) * CELL_M, 0.0).astype(np.float32)
    hub_only = "corridor" if plan.kind in SMALL_KINDS else ""
    central = np.isin(number, [k for k, room in enumerate(plan.rooms) if room.use != hub_only])
    return FreeFloor(low, clearance, central), number


def _fill(grid: NDArray[np.bool_], footprint: Footprint, origin: Floats, value: bool) -> None:
    """Set the cells that a footprint touches."""
    corners = footprint.corners()
    first = np.maximum(np.floor((corners.min(axis=0) - origin) / CELL_M).astype(int) - 1, 0)
    last = np.minimum(np.ceil((corners.max(axis=0) - origin) / CELL_M).astype(int) + 1, grid.shape)
    if (last <= first).any():
        return
    i, j = np.meshgrid(np.arange(first[0], last[0]), np.arange(first[1], last[1]), indexing="ij")
    dx, dy = (
        axis - place
        for axis, place in zip(
            (origin[0] + (i + 0.5) * CELL_M, origin[1] + (j + 0.5) * CELL_M), (footprint.x, footprint.y), strict=True
        )
    )
    cos, sin = footprint.heading
    touched = (np.abs(dx * cos + dy * sin) < footprint.half_x + CELL_M / 2) & (
        np.abs(dy * cos - dx * sin) < footprint.half_y + CELL_M / 2
    )
    grid[i[touched], j[touched]] = value


def _stations(floor: FreeFloor, number: NDArray[np.int32], rng: np.random.Generator) -> Floats:
    """Scanner positions: in each room as many as its size asks for, far from each other and from what is around."""
    found: list[list[float]] = []
    for k in range(int(number.max()) + 1):
        cells = np.argwhere((number == k) & (floor.clearance >= STATION_CLEARANCE_M))
        if not len(cells):
            continue
        area = float((number == k).sum()) * CELL_M**2
        count = max(2 if area > 8.0 else 1, round(area / STATION_AREA_M2))
        places = floor.centers(cells)
        clear = floor.clearance[tuple(cells.T)]
        reach = np.full(len(places), 3.0)
        for _ in range(count):
            score = np.minimum(reach, 3.0) + np.minimum(clear, 1.0) + rng.uniform(0.0, 0.6, len(places))
            best = int(np.argmax(score))
            if reach[best] < 1.2:
                break
            found.append([*places[best], STATION_HEIGHT_M + float(rng.uniform(-0.15, 0.25))])
            reach = np.minimum(reach, np.hypot(*(places - places[best]).T))
    return np.array(found).reshape(-1, 3)
