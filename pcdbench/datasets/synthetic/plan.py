"""Floor plans: rooms as outlines of their inner faces, and the doors, windows and passages in their walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

INNER_WALL_M = 0.14
OUTER_WALL_M = 0.32


@dataclass(frozen=True, eq=False)
class Opening:
    """A hole in a wall.

    Attributes:
        start, end: (2,) its two ends on the inner face of one room's wall, metres.
        z0, z1: its height above the floor.
        kind: `door`, `passage` (no leaf), `window`, `glazing` (a glazed partition).
        swing_deg: how far a door stands open; 0 is closed.
    """

    start: Floats
    end: Floats
    z0: float
    z1: float
    kind: str
    swing_deg: float = 0.0

    @cached_property
    def width(self) -> float:
        return float(np.hypot(*(self.end - self.start)))

    @property
    def center(self) -> Floats:
        return (self.start + self.end) / 2


@dataclass(frozen=True, eq=False)
class Room:
    """A space with a floor, walls and a ceiling.

    Attributes:
        use: what it is furnished as.
        outline: (K, 2) inner faces of its walls, counter-clockwise, metres.
        height: of its ceiling.
        ceiling: `tiles` (suspended), `plain` or `open` (bare slab with ducts).
    """

    use: str
    outline: Floats
    height: float
    floor: str
    wall: str
    accent: str
    ceiling: str
    tint: int

    def edges(self) -> tuple[tuple[Floats, Floats], ...]:
        """The wall segments, the room on their left."""
        return self._edges

    @cached_property
    def _edges(self) -> tuple[tuple[Floats, Floats], ...]:
        return tuple((self.outline[k], self.outline[(k + 1) % len(self.outline)]) for k in range(len(self.outline)))

    @cached_property
    def edge_lengths(self) -> tuple[float, ...]:
        """The lengths of `edges()`, metres."""
        return tuple(float(np.hypot(*(end - start))) for start, end in self.edges())


@dataclass(frozen=True, eq=False)
class Plan:
    """Rooms and what connects them."""

    kind: str
    rooms: tuple[Room, ...]
    openings: tuple[Opening, ...]
    columns: tuple[tuple[float, float, float, bool], ...] = field(default=())

    @cached_property
    def _openings_found(self) -> dict[tuple[bytes, bytes], tuple[tuple[float, float, Opening], ...]]:
        return {}

    def openings_of(self, start: Floats, end: Floats) -> tuple[tuple[float, float, Opening], ...]:
        """The openings in a wall segment, each with its interval along it (metres from `start`)."""
        wall = (start.tobytes(), end.tobytes())
        if wall not in self._openings_found:
            self._openings_found[wall] = self._openings_between(start, end)
        return self._openings_found[wall]

    def _openings_between(self, start: Floats, end: Floats) -> tuple[tuple[float, float, Opening], ...]:
        length = float(np.hypot(*(end - start)))
        along = (end - start) / length
        found = []
        for opening in self.openings:
            towards = opening.end - opening.start
            if abs(towards[0] * along[1] - towards[1] * along[0]) > 1e-6 * opening.width:
                continue
            offset = opening.start - start
            if abs(offset[0] * along[1] - offset[1] * along[0]) > INNER_WALL_M + 0.01:
                continue
            first, last = sorted((float(offset @ along), float((opening.end - start) @ along)))
            if last > 0.0 and first < length:
                found.append((max(first, 0.0), min(last, length), opening))
        return tuple(sorted(found, key=lambda item: item[:2]))

    def shared(self, start: Floats, end: Floats) -> list[tuple[float, float, Room]]:
        """The intervals of a wall segment (metres from `start`) with another room behind them, and that room."""
        length = float(np.hypot(*(end - start)))
        along = (end - start) / length
        outward = np.array([along[1], -along[0]])
        rooms, starts, ends = self._walls
        off = (starts - start) @ outward
        found = []
        # Roughly first, all at once; the few that are left are measured exactly below.
        for k in np.flatnonzero((off > 0.01) & (off < INNER_WALL_M + 0.03)):
            room, a, b = rooms[k], starts[k], ends[k]
            towards = (b - a) / np.hypot(*(b - a))
            gap = float((a - start) @ outward)
            if towards @ along > -0.9999 or not 0.02 < gap < INNER_WALL_M + 0.02:
                continue
            first, last = max(0.0, float((b - start) @ along)), min(length, float((a - start) @ along))
            if last - first > 0.05:
                found.append((first, last, room))
        return sorted(found, key=lambda item: item[:2])

    @cached_property
    def _walls(self) -> tuple[list[Room], Floats, Floats]:
        """The room, the start and the end of every wall segment."""
        walls = [(room, start, end) for room in self.rooms for start, end in room.edges()]
        ends = np.array([wall[1:] for wall in walls]).reshape(-1, 2, 2)
        return [wall[0] for wall in walls], ends[:, 0], ends[:, 1]


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Floats:
    """Its corners, counter-clockwise."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], np.float64)


def cut_corner(outline: Floats, corner: int, ways: str, size: tuple[float, float]) -> Floats:
    """The outline with one corner taken away.

    Args:
        ways: `notch` (a rectangle), `slant` (a slanted wall) or `round` (a quarter of an ellipse).
        size: how much of the wall before the corner, and of the one after it, metres.
    """
    here = outline[corner]
    before = outline[corner - 1] - here
    after = outline[(corner + 1) % len(outline)] - here
    u = before / np.hypot(*before) * size[0]
    v = after / np.hypot(*after) * size[1]
    if ways == "notch":
        corners = [here + u, here + u + v, here + v]
    elif ways == "slant":
        corners = [here + u, here + v]
    else:
        turns = [step * math.pi / 16 for step in range(9)]
        corners = [here + u * (1 - math.sin(turn)) + v * (1 - math.cos(turn)) for turn in turns]
    return np.concatenate([outline[:corner], corners, outline[corner + 1 :]])


def bumped(outline: Floats, edge: int, first: float, last: float, depth: float) -> Floats:
    """The outline with a wall set in by `depth` between two lengths along it: a shaft, a chimney, a pier."""
    start, end = outline[edge], outline[(edge + 1) % len(outline)]
    along = (end - start) / np.hypot(*(end - start))
    inward = np.array([-along[1], along[0]])
    corners = [
        start + along * first,
        start + along * first + inward * depth,
        start + along * last + inward * depth,
        start + along * last,
    ]
    return np.concatenate([outline[: edge + 1], corners, outline[edge + 1 :]])


def contains(outline: Floats, points: ArrayLike) -> NDArray[np.bool_]:
    """(N,) mask of the (N, 2) points inside a simple polygon (crossing number)."""
    inside = np.asarray(points, np.float64).reshape(-1, 2)
    x, y = inside[:, :1], inside[:, 1:]
    ax, ay = outline[:, 0], outline[:, 1]
    bx, by = np.concatenate((ax[1:], ax[:1])), np.concatenate((ay[1:], ay[:1]))
    crosses = (ay > y) != (by > y)
    rise = np.where(by == ay, 1.0, by - ay)
    return np.logical_xor.reduce(crosses & (x < ax + (y - ay) / rise * (bx - ax)), axis=1)


def connect(
    rooms: Sequence[Room], a: int, b: int, kind: str, width: float, rng: np.random.Generator, top: float = 2.05
) -> Opening | None:
    """An opening between two rooms where their walls meet for long enough, or None where they do not."""
    plan = Plan("", (rooms[b],), ())
    best: tuple[float, Floats, Floats, float, float] | None = None
    for start, end in rooms[a].edges():
        for first, last, _ in plan.shared(start, end):
            if last - first >= width + 0.3 and (best is None or last - first > best[0]):
                best = (last - first, start, end, first, last)
    if best is None:
        return None
    _, start, end, first, last = best
    along = (end - start) / np.hypot(*(end - start))
    near_end = rng.uniform() < 0.5 and kind == "door"
    place = first + 0.15 + rng.uniform(0.05, 0.15) if near_end else rng.uniform(first + 0.15, last - width - 0.15)
    place = min(place, last - width - 0.1)
    swing = 0.0
    if kind == "door":
        swing = float(rng.choice([0.0, 12.0, 55.0, 85.0, 95.0, 110.0], p=[0.2, 0.1, 0.15, 0.25, 0.2, 0.1]))
    p = start + along * place
    return Opening(p, p + along * width, 0.0, min(top, rooms[a].height - 0.1, rooms[b].height - 0.1), kind, swing)


def windows(plan: Plan, room: Room, rng: np.random.Generator, share: float = 0.8) -> list[Opening]:
    """Windows in those walls of a room that have nothing behind them."""
    found: list[Opening] = []
    tall = rng.uniform() < 0.3
    z0 = 0.12 if tall else float(rng.uniform(0.75, 1.05))
    z1 = min(room.height - 0.25, float(rng.uniform(2.2, 2.6)))
    pane = float(rng.uniform(1.0, 2.2))
    pier = float(rng.uniform(0.25, 0.9))
    for start, end in room.edges():
        length = float(np.hypot(*(end - start)))
        if length < 1.8 or plan.shared(start, end) or rng.uniform() > share:
            continue
        taken = plan.openings_of(start, end)
        along = (end - start) / length
        count = int((length - 0.5) // (pane + pier))
        first = (length - count * pane - (count - 1) * pier) / 2
        for k in range(count):
            a = first + k * (pane + pier)
            if all(a + pane < lo - 0.1 or a > hi + 0.1 for lo, hi, _ in taken):
                p = start + along * a
                found.append(Opening(p, p + along * pane, z0, z1, "window"))
    return found


def with_openings(plan: Plan, more: Sequence[Opening]) -> Plan:
    """The plan with further openings."""
    return replace(plan, openings=plan.openings + tuple(more))
