"""An environment: a furnished building as one labelled mesh, what is tagged in it, and where one can stand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pcdbench.datasets.synthetic.building import Light
from pcdbench.datasets.synthetic.materials import MATERIALS
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.geometry.visibility import MeshRaycaster
from pcdbench.scene import TaggedObject

Floats = NDArray[np.float64]

CELL_M = 0.1


@dataclass(frozen=True, eq=False)
class FreeFloor:
    """Where on the floor a person or a tripod can stand, on a grid of 0.1 m cells.

    Attributes:
        origin: (2,) the lowest corner of cell (0, 0), metres.
        clearance: (X, Y) metres from each cell's centre to the nearest wall or thing on the floor; 0 in them.
        central: (X, Y) whether the cell is in a room that shows what the environment is (not its corridor, if small).
    """

    origin: Floats
    clearance: NDArray[np.float32]
    central: NDArray[np.bool_]

    def centers(self, cells: NDArray[np.int64]) -> Floats:
        """(N, 2) the middles of cells (N, 2), metres."""
        return self.origin + (cells + 0.5) * CELL_M

    def clearance_at(self, points: Floats) -> Floats:
        """(N,) metres of free floor around points (N, 2); 0 outside of the environment."""
        cells = np.floor((np.asarray(points).reshape(-1, 2) - self.origin) / CELL_M).astype(np.int64)
        known = ((cells >= 0) & (cells < self.clearance.shape)).all(axis=1)
        found = np.zeros(len(cells))
        found[known] = self.clearance[tuple(cells[known].T)]
        return found


@dataclass(frozen=True, eq=False)
class Environment:
    """A furnished building, floor at z = 0, metres.

    Attributes:
        name: `env012` and the like.
        kind: `corridor`, `office` and so on.
        mesh: everything there is, without the outside of the building.
        pieces: (T,) int32 which piece each triangle belongs to; 0 is the building.
        poses: (P, 4) x, y, z and yaw of each piece's own frame, in which its texture is fixed.
        objects: what is tagged.
        object_pieces: the piece of each tagged object.
        lights: lamps and windows.
        stations: (S, 3) where a surveyor would place a scanner.
        floor: where one can stand.
    """

    name: str
    kind: str
    mesh: Mesh
    pieces: NDArray[np.int32]
    poses: Floats
    objects: tuple[TaggedObject, ...]
    object_pieces: tuple[int, ...]
    lights: tuple[Light, ...]
    stations: Floats
    floor: FreeFloor

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """The lowest and the highest corner of all rooms, (3,) metres each."""
        return self.mesh.bounds()

    @cached_property
    def opaque(self) -> NDArray[np.int64]:
        """The rows of the triangles that stop rays: all but panes of glass."""
        transparent = np.array([material.transparent for material in MATERIALS])
        return np.flatnonzero(~transparent[self.mesh.materials])

    @cached_property
    def reflectance(self) -> Floats:
        """The probability that a scanner's ray comes back from each of the `opaque` triangles, hit squarely."""
        lost = np.array([1.0 if material.mirror else material.dropout for material in MATERIALS])
        return 1.0 - lost[self.mesh.materials[self.opaque]]

    @cached_property
    def raycaster(self) -> MeshRaycaster:
        """Casts rays on the opaque triangles; its triangle numbers are rows of `opaque`."""
        return MeshRaycaster(self.mesh.vertices, self.mesh.triangles[self.opaque])
