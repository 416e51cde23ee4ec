"""Rooms for floor plans: their finishes, their outlines, rows of them and the doors to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pcdbench.datasets.synthetic.plan import (
    INNER_WALL_M,
    Floats,
    Opening,
    Plan,
    Room,
    connect,
    cut_corner,
    rectangle,
)

_FLOORS: dict[str, tuple[str, ...]] = {
    "corridor": ("linoleum", "terrazzo", "floor_tiles", "carpet"),
    "hallway": ("terrazzo", "linoleum", "floor_tiles"),
    "lobby": ("marble", "terrazzo", "floor_tiles", "parquet"),
    "kitchen": ("floor_tiles", "small_floor_tiles", "linoleum", "planks"),
    "storage": ("linoleum", "concrete", "floor_tiles"),
    "classroom": ("linoleum", "parquet", "planks"),
}
_WALLS: dict[str, tuple[str, ...]] = {
    "kitchen": ("wall_tiles", "wall_paint", "plaster"),
    "storage": ("concrete", "brick", "wall_paint"),
    "lobby": ("plaster", "wood_panelling", "wall_paint", "concrete"),
}
_MANY_FLOORS = ("carpet", "parquet", "planks", "linoleum", "carpet")
_MANY_WALLS = ("wall_paint", "wall_paint", "plaster", "wallpaper")
_ACCENTS = ("brick", "wood_panelling", "wall_paint", "wallpaper", "wall_paint", "concrete")


def room_of(use: str, outline: Floats, rng: np.random.Generator, height: float) -> Room:
    """A room with floor, walls and ceiling as its use suggests."""
    choice = rng.uniform()
    ceiling = "tiles" if choice < 0.4 else "plain" if choice < 0.65 else "open"
    return Room(
        use=use,
        outline=outline,
        height=height,
        floor=str(rng.choice(_FLOORS.get(use, _MANY_FLOORS))),
        wall=str(rng.choice(_WALLS.get(use, _MANY_WALLS))),
        accent=str(rng.choice(_ACCENTS)),
        ceiling=ceiling,
        tint=int(rng.integers(0, 2**31)),
    )


def random_height(rng: np.random.Generator, low: float = 2.55, high: float = 3.2) -> float:
    """Metres from floor to ceiling."""
    return float(rng.uniform(low, high))


def shaped(outline: Floats, rng: np.random.Generator, corners: Sequence[int], strength: float = 1.0) -> Floats:
    """An outline made less of a rectangle: cut corners and piers, at these corners or between them."""
    sides = np.hypot(*(np.roll(outline, -1, axis=0) - outline).T)
    cut = outline
    for corner in sorted(corners, reverse=True):
        draw = rng.uniform()
        if draw > 0.75 * strength:
            continue
        before, after = sides[corner - 1], sides[corner]
        if draw < 0.4 * strength:
            size = (float(before * rng.uniform(0.12, 0.3)), float(after * rng.uniform(0.12, 0.3)))
            cut = cut_corner(cut, corner, "notch", size)
        else:
            reach = float(rng.uniform(0.8, min(2.4, 0.4 * min(before, after) + 0.81)))
            ways = "slant" if draw < 0.58 * strength else "round"
            cut = cut_corner(cut, corner, ways, (reach, float(reach * rng.uniform(0.8, 1.2))))
    return cut


def row_of_rooms(
    x0: float, x1: float, y0: float, depth: float, upward: bool, uses: Sequence[str], rng: np.random.Generator
) -> list[Room]:
    """Rooms side by side from x0 to x1, with their fronts on the line y0, going up or down from it."""
    count = max(1, round((x1 - x0) / float(rng.uniform(3.2, 4.8))))
    shares = rng.uniform(0.7, 1.4, count)
    walls = (count - 1) * INNER_WALL_M
    widths = shares / shares.sum() * (x1 - x0 - walls)
    rooms, at = [], x0
    for width in widths:
        low, high = (y0, y0 + depth) if upward else (y0 - depth, y0)
        far = (2, 3) if upward else (0, 1)
        outline = shaped(rectangle(at, low, at + width, high), rng, far, 0.45)
        rooms.append(room_of(str(rng.choice(uses)), outline, rng, random_height(rng, 2.5, 3.0)))
        at += width + INNER_WALL_M
    return rooms


def doors_to(
    rooms: list[Room], hub: int, members: Sequence[int], rng: np.random.Generator, glazed: float
) -> list[Opening | None]:
    """A door from each member room to the hub, and sometimes a glazed front beside it."""
    found: list[Opening | None] = []
    for member in members:
        door = connect(rooms, member, hub, "door", float(rng.uniform(0.86, 1.05)), rng)
        found.append(door)
        if door is None or rng.uniform() > glazed:
            continue
        for start, end in rooms[member].edges():
            spans = Plan("", (rooms[hub],), ()).shared(start, end)
            placed = Plan("", (), (door,)).openings_of(start, end)
            if not spans or not placed:
                continue
            along = (end - start) / np.hypot(*(end - start))
            low, high = spans[0][0] + 0.25, spans[0][1] - 0.25
            a, b = placed[0][:2]
            first, last = max(((low, a - 0.15), (b + 0.15, high)), key=lambda gap: gap[1] - gap[0])
            if last - first > 0.9:
                top = min(rooms[member].height, rooms[hub].height) - 0.25
                z0 = float(rng.choice([0.02, 0.9]))
                found.append(Opening(start + along * first, start + along * last, z0, min(top, 2.4), "glazing"))
    return found
