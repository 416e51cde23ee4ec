"""The building around the furniture: floors, walls with reveals, doors, windows, ceilings, columns, services."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pcdbench.datasets.synthetic.joinery import filling
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.plan import INNER_WALL_M, OUTER_WALL_M, Floats, Opening, Plan, Room, contains
from pcdbench.datasets.synthetic.primitives import box, cylinder, ellipsoid, panel_with_openings, prism, surface, tube


@dataclass(frozen=True, eq=False)
class Light:
    """Something that lights a room.

    Attributes:
        position: (3,) metres.
        facing: (3,) unit direction of its strongest light.
        strength: of its light at one metre, relative.
    """

    position: Floats
    facing: Floats
    strength: float


@dataclass(frozen=True, eq=False)
class Building:
    """The building's mesh and its lamps and windows."""

    mesh: Mesh
    lights: tuple[Light, ...]


def build(plan: Plan, rng: np.random.Generator) -> Building:
    """The building of a plan."""
    parts: list[Mesh] = []
    lights: list[Light] = []
    for room in plan.rooms:
        parts += [*_shell(plan, room, rng), *_services(room, rng)]
        lamps, lit = _lamps(room, rng)
        parts += lamps
        lights += lit
    for opening in plan.openings:
        parts += filling(opening, rng)
        if opening.kind == "window":
            lights.append(_daylight(opening))
    for x, y, half, is_round in plan.columns:
        parts += _column(plan, x, y, half, is_round, rng)
    return Building(Mesh.merge(parts), tuple(lights))


def wall_frame(start: Floats, end: Floats) -> tuple[float, Floats, float]:
    """Of a wall segment with the room on its left: its length, unit direction, and the yaw of x along it."""
    length = float(np.hypot(*(end - start)))
    along = (end - start) / length
    return length, along, float(np.arctan2(along[1], along[0]))


def _shell(plan: Plan, room: Room, rng: np.random.Generator) -> list[Mesh]:
    """Floor, ceiling, walls and skirting of a room."""
    parts = [
        prism(room.outline, -0.12, 0.0, room.floor, room.tint),
        prism(room.outline, room.height, room.height + 0.1, _ceiling_material(room), room.tint + 1),
    ]
    accent = int(rng.integers(0, len(room.outline)))
    has_skirting = room.wall not in ("wall_tiles", "concrete") and rng.uniform() < 0.8
    for number, (start, end) in enumerate(room.edges()):
        length, along, yaw = wall_frame(start, end)
        if length < 1e-3:
            continue
        inward = np.array([-along[1], along[0]])
        thickness = INNER_WALL_M / 2 if plan.shared(start, end) else OUTER_WALL_M
        holes = plan.openings_of(start, end)
        cuts = [(first, last, hole.z0, hole.z1) for first, last, hole in holes]
        material = room.accent if number == accent else room.wall
        tint = room.tint + (3 if number == accent else 2)
        panel = panel_with_openings(length, room.height, thickness, cuts, material, tint, "plaster", room.tint)
        shift = start - inward * thickness / 2
        parts.append(panel.moved((*shift, 0.0), yaw))
        if has_skirting:
            at_floor = sorted((first, last) for first, last, hole in holes if hole.z0 < 0.1)
            for first, last in _gaps(at_floor, length):
                strip = box((last - first, 0.015, 0.09), ((first + last) / 2, 0.0075, 0.045), "baseboard", room.tint)
                parts.append(strip.moved((*start, 0.0), yaw))
    return parts


def _gaps(taken: list[tuple[float, float]], length: float) -> list[tuple[float, float]]:
    """What a row of intervals leaves free of 0..length, pieces longer than 5 cm."""
    free, at = [], 0.0
    for first, last in [*taken, (length, length)]:
        if first - at > 0.05:
            free.append((at, first))
        at = max(at, last)
    return free


def _ceiling_material(room: Room) -> str:
    return {"tiles": "ceiling_panels", "plain": "ceiling_paint", "open": "concrete"}[room.ceiling]


def _daylight(window: Opening) -> Light:
    along = (window.end - window.start) / window.width
    inward = np.array([-along[1], along[0], 0.0])
    middle = np.array([*window.center, (window.z0 + window.z1) / 2])
    facing = inward * 0.85 + np.array([0.0, 0.0, -0.53])
    return Light(middle - inward * 0.1, facing, 1.1 * window.width * (window.z1 - window.z0))


def _lamps(room: Room, rng: np.random.Generator) -> tuple[list[Mesh], list[Light]]:
    """Ceiling lamps on a grid over the room, of one kind."""
    low, high = room.outline.min(axis=0), room.outline.max(axis=0)
    spacing = float(rng.uniform(1.9, 2.9))
    counts = np.maximum(1, np.rint((high - low) / spacing)).astype(int)
    style = str(rng.choice(["panel", "tube", "pendant", "spot"], p=[0.4, 0.25, 0.2, 0.15]))
    tint = int(rng.integers(0, 2**31))
    turned = bool((high - low)[1] > (high - low)[0])
    parts: list[Mesh] = []
    lights: list[Light] = []
    for i in range(counts[0]):
        for j in range(counts[1]):
            x, y = low + (high - low) * (np.array([i, j]) + 0.5) / counts
            square = np.array([x, y]) + np.array([[a, b] for a in (-0.5, 0.5) for b in (-0.5, 0.5)])
            if not contains(room.outline, square).all() and not contains(room.outline, [[x, y]])[0]:
                continue
            lamp, drop = _lamp(style, tint, room.height)
            parts.append(lamp.moved((x, y, room.height), np.pi / 2 if turned else 0.0))
            lights.append(Light(np.array([x, y, room.height - drop]), np.array([0.0, 0.0, -1.0]), 2.2))
    return parts, lights


def _lamp(style: str, tint: int, height: float) -> tuple[Mesh, float]:
    """A lamp with the ceiling at z = 0, and how far below it the light is."""
    if style == "panel":
        return Mesh.merge(
            [
                box((0.62, 0.62, 0.025), (0, 0, -0.0125), "painted_metal", tint),
                box((0.57, 0.57, 0.02), (0, 0, -0.02), "lamp", tint),
            ]
        ), 0.05
    if style == "tube":
        return Mesh.merge(
            [
                box((1.25, 0.13, 0.05), (0, 0, -0.025), "painted_metal", tint),
                tube([(-0.6, 0, -0.07), (0.6, 0, -0.07)], 0.02, "lamp", tint, 8),
            ]
        ), 0.1
    if style == "pendant":
        drop = min(0.9, max(0.25, height - 2.2))
        cone = [(0.03, -drop + 0.22), (0.07, -drop + 0.2), (0.2, -drop)]
        angle = 2 * np.pi * np.arange(16) / 16
        rings = [[(r * np.cos(a), r * np.sin(a), z) for a in angle] for r, z in cone[::-1]]
        return Mesh.merge(
            [
                tube([(0, 0, 0), (0, 0, -drop + 0.2)], 0.008, "black_metal", tint, 6),
                surface(rings, "colored_metal", tint, closed=True),
                ellipsoid((0.06, 0.06, 0.06), (0, 0, -drop + 0.06), "lamp", tint, 10),
            ]
        ), drop
    return Mesh.merge(
        [
            cylinder(0.09, 0.012, (0, 0, -0.012), "painted_metal", tint),
            cylinder(0.07, 0.006, (0, 0, -0.018), "lamp", tint),
        ]
    ), 0.03


def _services(room: Room, rng: np.random.Generator) -> list[Mesh]:
    """Beams, soffits, ducts, pipes, cable trays."""
    parts: list[Mesh] = []
    low, high = room.outline.min(axis=0), room.outline.max(axis=0)
    long_x = bool((high - low)[0] >= (high - low)[1])
    tint = int(rng.integers(0, 2**31))
    across = int(not long_x)
    if room.ceiling == "open" or rng.uniform() < 0.25:
        count = max(1, int((high - low)[1 - across] // 3.2))
        for k in range(count):
            at = low[1 - across] + (high - low)[1 - across] * (k + 0.5) / count + 0.35
            parts += _spanning(room, 1 - across, at, 0.24, float(rng.uniform(0.18, 0.35)), "concrete", tint)
    if room.ceiling == "open":
        side = low[across] + float(rng.uniform(0.5, 0.9))
        z = room.height - 0.62
        for radius, offset, material in (
            (0.16, 0.0, "galvanized"),
            (0.03, 0.35, "colored_metal"),
            (0.03, 0.45, "painted_metal"),
        ):
            for a, b in _inside(room, across, side + offset):
                ends = np.zeros((2, 3))
                ends[:, across], ends[:, 2] = side + offset, z + (0.0 if radius > 0.1 else 0.1)
                ends[:, 1 - across] = a + 0.02, b - 0.02
                parts.append(tube(ends, radius, material, tint, 12))
        tray = high[across] - float(rng.uniform(0.5, 0.9))
        parts += _spanning(room, across, tray, 0.3, 0.07, "galvanized", tint, room.height - 0.45)
    elif rng.uniform() < 0.4:
        width = float(rng.uniform(0.35, 0.8))
        side = low[across] + width / 2 if rng.uniform() < 0.5 else high[across] - width / 2
        parts += _spanning(room, across, side, width, float(rng.uniform(0.15, 0.4)), "ceiling_paint", tint)
    if rng.uniform() < 0.4:
        corner = room.outline[int(rng.integers(0, len(room.outline)))]
        inside = corner + np.sign((low + high) / 2 - corner) * 0.09
        if contains(room.outline, [inside])[0]:
            parts.append(cylinder(0.045, room.height, (*inside, 0.0), "painted_metal", tint, 12))
    return parts


def _inside(room: Room, axis: int, at: float) -> list[tuple[float, float]]:
    """The intervals, along the other axis, in which a line of constant `axis` coordinate lies in the room."""
    hits = []
    for start, end in room.edges():
        if (start[axis] > at) != (end[axis] > at):
            share = (at - start[axis]) / (end[axis] - start[axis])
            hits.append(float(start[1 - axis] + share * (end[1 - axis] - start[1 - axis])))
    hits.sort()
    return list(zip(hits[::2], hits[1::2], strict=True))


def _spanning(
    room: Room, axis: int, at: float, width: float, tall: float, material: str, tint: int, top: float | None = None
) -> list[Mesh]:
    """Boxes from wall to wall along the line of constant `axis` coordinate, under the ceiling."""
    z1 = room.height if top is None else top
    found = []
    for a, b in _inside(room, axis, at):
        size, center = np.zeros(3), np.zeros(3)
        size[axis], size[1 - axis], size[2] = width, b - a, tall
        center[axis], center[1 - axis], center[2] = at, (a + b) / 2, z1 - tall / 2
        found.append(box(size, center, material, tint))
    return found


def _column(plan: Plan, x: float, y: float, half: float, is_round: bool, rng: np.random.Generator) -> list[Mesh]:
    room = next((room for room in plan.rooms if contains(room.outline, [[x, y]])[0]), None)
    if room is None:
        return []
    tint = int(rng.integers(0, 2**31))
    material = str(rng.choice(["concrete", "plaster", "wall_paint"]))
    if is_round:
        shaft = cylinder(half, room.height, (x, y, 0.0), material, tint, 28)
        foot = cylinder(half + 0.02, 0.1, (x, y, 0.0), "baseboard", tint, 28)
    else:
        shaft = box((2 * half, 2 * half, room.height), (x, y, room.height / 2), material, tint)
        foot = box((2 * half + 0.03, 2 * half + 0.03, 0.1), (x, y, 0.05), "baseboard", tint)
    return [shaft, foot]
