"""Putting pieces into rooms without letting them meet: footprints, walls, tops, doors kept clear."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcdbench.datasets.synthetic.footprints import Footprint, Footprints
from pcdbench.datasets.synthetic.furniture import FURNITURE, Built
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.plan import Floats, Plan, Room, contains
from pcdbench.scene import Box, TaggedObject

DOOR_DEPTH_M = 1.0
MODELS = 4


@dataclass(frozen=True, eq=False)
class Placed:
    """A piece in its place."""

    name: str
    built: Built
    footprint: Footprint
    pose: tuple[float, float, float, float]

    def to_scene(self, local: Floats) -> Floats:
        """(N, 2) points of the piece's own frame in the scene's."""
        cos, sin = math.cos(self.pose[3]), math.sin(self.pose[3])
        return np.array(self.pose[:2]) + np.asarray(local) @ np.array([[cos, sin], [-sin, cos]])


class Placement:
    """What stands in a building so far; `put` and its relatives add to it."""

    def __init__(self, plan: Plan, rng: np.random.Generator) -> None:
        self.plan = plan
        self.rng = rng
        self.placed: list[Placed] = []
        self.solid = Footprints()
        for x, y, half, _ in plan.columns:
            self.solid.add(Footprint(x, y, half, half, 0.0, 0.0, 9.0))
        self.kept_clear: list[Footprint] = []
        self.models: dict[str, list[Built]] = {}
        for opening in plan.openings:
            if opening.z0 < 0.1 and opening.kind in ("door", "passage"):
                along = (opening.end - opening.start) / opening.width
                x, y = opening.center
                yaw = math.atan2(along[1], along[0])
                self.kept_clear.append(Footprint(x, y, opening.width / 2 + 0.1, DOOR_DEPTH_M, yaw, 0.0, 2.3))

    def build(self, name: str) -> Built:
        """One of a piece: of each kind a building holds a few models, as real ones do."""
        models = self.models.setdefault(name, [])
        if len(models) < MODELS:
            models.append(FURNITURE[name].build(np.random.default_rng(int(self.rng.integers(0, 2**63)))))
            return models[-1]
        return models[int(self.rng.integers(0, len(models)))]

    def put(
        self,
        room: Room,
        name: str,
        built: Built,
        x: float,
        y: float,
        yaw_rad: float,
        z: float = 0.0,
        gap: float = 0.03,
        beside: Placed | None = None,
    ) -> Placed | None:
        """Put a piece with its own origin at (x, y, z), or None where something is in the way.

        Args:
            beside: a piece that it may reach under or over (a chair its desk).
        """
        # In Python's floats here and below: arithmetic with numpy's takes three times as long.
        (x0, y0, z0), (x1, y1, z1) = built.corners
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        cx, cy = (x0 + x1) / 2, (y0 + y1) / 2
        footprint = Footprint(
            x + cx * cos - cy * sin,
            y + cx * sin + cy * cos,
            (x1 - x0) / 2,
            (y1 - y0) / 2,
            yaw_rad,
            z + z0 + 0.001,
            z + z1,
        )
        if not self._fits(room, footprint, gap, beside):
            return None
        placed = Placed(name, built, footprint, (x, y, z, yaw_rad))
        self.placed.append(placed)
        self.solid.add(footprint)
        return placed

    def _fits(self, room: Room, footprint: Footprint, gap: float, beside: Placed | None) -> bool:
        if footprint.z1 > room.height:
            return False
        allowed = None if beside is None else beside.footprint
        for other in self.solid.near(footprint, gap):
            if other is not allowed and footprint.meets(other, gap):
                return False
        if footprint.z0 <= 2.0 and any(footprint.meets(other, 0.0) for other in self.kept_clear):
            return False
        return bool(contains(room.outline, footprint.corners()).all()) and not footprint.holds(room.outline)

    def somewhere(
        self, room: Room, name: str, tries: int = 12, margin: float = 0.3, yaw_rad: float | None = None
    ) -> Placed | None:
        """Put a piece anywhere in the room, turned at random unless a yaw is given."""
        built = self.build(name)
        low, high = room.outline.min(axis=0), room.outline.max(axis=0)
        for _ in range(tries):
            x, y = self.rng.uniform(low, high)
            yaw = float(self.rng.uniform(-np.pi, np.pi)) if yaw_rad is None else yaw_rad
            placed = self.put(room, name, built, float(x), float(y), yaw, gap=margin)
            if placed:
                return placed
        return None

    def at_wall(
        self,
        room: Room,
        name: str,
        z: float | tuple[float, float] = 0.0,
        tries: int = 10,
        jitter_rad: float = 0.0,
        off_m: float = 0.01,
        gap: float = 0.04,
        flipped: bool = False,
    ) -> Placed | None:
        """Put a piece with its back to a wall of the room, clear of doors, and of windows it would hide."""
        built = self.build(name)
        low, high = built.corners
        width = high[0] - low[0]
        edges = [
            (*edge, length)
            for edge, length in zip(room.edges(), room.edge_lengths, strict=True)
            if length > width + 0.05
        ]
        for _ in range(tries if edges else 0):
            start, end, length = edges[int(self.rng.integers(0, len(edges)))]
            first = float(self.rng.uniform(0.02, length - width - 0.02))
            up = float(self.rng.uniform(*z)) if isinstance(z, tuple) else z
            placed = self.on_wall(room, name, built, start, end, first, up, jitter_rad, off_m, gap, flipped)
            if placed:
                return placed
        return None

    def on_wall(
        self,
        room: Room,
        name: str,
        built: Built,
        start: Floats,
        end: Floats,
        first: float,
        z: float = 0.0,
        jitter_rad: float = 0.0,
        off_m: float = 0.01,
        gap: float = 0.04,
        flipped: bool = False,
    ) -> Placed | None:
        """Put a piece at a wall segment, one end `first` metres from the segment's start.

        Args:
            flipped: its front to the wall (desks: who sits at them looks towards +y of their frame).
        """
        low, high = built.corners
        width = high[0] - low[0]
        (start_x, start_y), (end_x, end_y) = start.tolist(), end.tolist()
        length = float(np.hypot(end_x - start_x, end_y - start_y))
        along_x, along_y = (end_x - start_x) / length, (end_y - start_y) / length
        for a, b, opening in self.plan.openings_of(start, end):
            hidden = z + high[2] > opening.z0 + 0.02 and z + low[2] < opening.z1
            if hidden and first < b + 0.08 and first + width > a - 0.08:
                return None
        turn = float(self.rng.uniform(-jitter_rad, jitter_rad)) if jitter_rad else 0.0
        off = off_m + abs(math.sin(turn)) * width / 2
        left, back = (high[0], high[1]) if flipped else (-low[0], -low[1])
        x = start_x + along_x * (first + left) - along_y * (off + back)
        y = start_y + along_y * (first + left) + along_x * (off + back)
        yaw = math.atan2(along_y, along_x) + turn + (math.pi if flipped else 0.0)
        return self.put(room, name, built, x, y, yaw, z, gap)

    def on_top(self, room: Room, holder: Placed, names: list[str], chance: float = 0.8, at_most: int = 6) -> None:
        """Put things on the tops of a placed piece."""
        for top in holder.built.tops:
            if self.rng.uniform() > chance:
                continue
            for _ in range(int(self.rng.integers(1, at_most + 1))):
                name = str(self.rng.choice(names))
                built = self.build(name)
                low, high = built.corners
                reach = float(np.hypot(high[0] - low[0], high[1] - low[1])) / 2
                room_x, room_y = top.size[0] / 2 - reach, top.size[1] / 2 - reach
                if room_x < 0 or room_y < 0:
                    continue
                spot = top.center + self.rng.uniform(-1.0, 1.0, 2) * [room_x, room_y]
                x, y = holder.to_scene(spot[None])[0]
                yaw = holder.pose[3] + float(self.rng.normal(0.0, 0.35))
                self.put(room, name, built, float(x), float(y), yaw, holder.pose[2] + top.z + 0.002, 0.005)

    def merged(self, building: Mesh) -> tuple[Mesh, NDArray[np.int32], Floats]:
        """All as one mesh; the piece of each triangle (0 the building); each piece's pose."""
        meshes, numbers = [building], [np.zeros(len(building.triangles), np.int32)]
        poses = [(0.0, 0.0, 0.0, 0.0)]
        for number, placed in enumerate(self.placed, start=1):
            mesh = placed.built.mesh.moved(placed.pose[:3], placed.pose[3])
            meshes.append(mesh)
            numbers.append(np.full(len(mesh.triangles), number, np.int32))
            poses.append(placed.pose)
        return Mesh.merge(meshes), np.concatenate(numbers), np.array(poses)

    def tagged(self) -> tuple[tuple[TaggedObject, ...], tuple[int, ...]]:
        """The pieces that someone would tag on a map, and their numbers."""
        found, numbers = [], []
        for number, placed in enumerate(self.placed, start=1):
            piece = FURNITURE[placed.name]
            if not piece.tagged:
                continue
            its = placed.footprint
            center = np.array([its.x, its.y, (its.z0 + its.z1) / 2])
            size = 2 * np.array([its.half_x, its.half_y, (its.z1 - its.z0) / 2])
            found.append(TaggedObject(piece.label, Box(center, size, its.yaw_rad)))
            numbers.append(number)
        return tuple(found), tuple(numbers)
