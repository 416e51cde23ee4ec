"""What is put together: workplaces, tables with chairs, seats around a low table, shelves along walls."""

from __future__ import annotations

import math

import numpy as np

from pcdbench.datasets.synthetic.furniture import FURNITURE
from pcdbench.datasets.synthetic.placement import Placed, Placement
from pcdbench.datasets.synthetic.plan import Floats, Room

DESK_THINGS = [
    "book_pile",
    "book_row",
    "mug",
    "paper_stack",
    "bottle",
    "pen_cup",
    "telephone",
    "laptop",
    "desk_lamp",
    "desk_plant",
    "small_box",
]
TABLE_THINGS = ["book_pile", "mug", "paper_stack", "bottle", "laptop", "bowl", "vase", "desk_plant"]
SHELF_THINGS = ["book_row", "book_pile", "small_box", "vase", "bowl", "desk_plant", "paper_stack", "desktop_printer"]
STORES = ["bookcase", "cabinet", "filing_cabinet", "wardrobe", "open_rack", "bookcase"]


def any_of(placement: Placement, names: list[str]) -> str:
    """One of the names at random; those that are there twice come twice as often."""
    return str(placement.rng.choice(names))


def spin(placement: Placement, degrees: float) -> float:
    """A random turn, radians, of this standard deviation in degrees."""
    return float(np.radians(placement.rng.normal(0.0, degrees)))


def put_workplace(placement: Placement, room: Room, desk: Placed) -> None:
    """A chair at a desk, not quite straight, and what is on the desk."""
    rng = placement.rng
    low, _ = desk.built.mesh.bounds()
    out = float(
        rng.choice([rng.uniform(0.1, 0.25), rng.uniform(0.3, 0.45), rng.uniform(0.5, 0.8)], p=[0.35, 0.45, 0.2])
    )
    turned = desk.pose[3] + spin(placement, 30.0 if out > 0.25 else 10.0)
    x, y = desk.to_scene(np.array([[rng.normal(0.0, 0.08), low[1] - out]]))[0]
    placement.put(room, "office_chair", placement.build("office_chair"), float(x), float(y), turned, 0.0, 0.0, desk)
    top = desk.built.tops[0]
    for _ in range(int(rng.choice([1, 1, 2]))):
        x, y = desk.to_scene(
            np.array([[top.center[0] + rng.uniform(-0.35, 0.35), top.center[1] + top.size[1] * 0.22]])
        )[0]
        yaw = desk.pose[3] + np.pi + spin(placement, 12.0)
        placement.put(room, "monitor", placement.build("monitor"), float(x), float(y), yaw, top.z + 0.002, 0.01, desk)
    x, y = desk.to_scene(np.array([[top.center[0] + rng.normal(0, 0.06), top.center[1] - top.size[1] * 0.28]]))[0]
    placement.put(
        room,
        "keyboard",
        placement.build("keyboard"),
        float(x),
        float(y),
        desk.pose[3] + spin(placement, 6),
        top.z + 0.002,
        0.0,
        desk,
    )
    placement.on_top(room, desk, DESK_THINGS, 0.9, 6)


def put_chairs_around(placement: Placement, room: Room, table: Placed, name: str, ends: bool = True) -> None:
    """Chairs on all sides of a table, some pulled out, some missing."""
    rng = placement.rng
    low, high = table.built.mesh.bounds()
    half, middle = (high - low)[:2] / 2, (high + low)[:2] / 2
    is_round = abs(half[0] - half[1]) < 0.12
    spots = []
    if is_round:
        count = max(3, int(2 * np.pi * half[0] / 0.85))
        for angle in np.arange(count) * 2 * np.pi / count + rng.uniform(0, 6):
            spots.append((half[0] * math.cos(angle), half[0] * math.sin(angle), angle))
    else:
        for axis in (0, 1):
            if axis == 1 and not ends:
                continue
            count = max(1, int(2 * half[axis] / 0.72))
            for k in range(count):
                along = (k - (count - 1) / 2) * 2 * half[axis] / count
                for side in (-1.0, 1.0):
                    x, y = (along, side * half[1]) if axis == 0 else (side * half[0], along)
                    angle = math.atan2(side, 0.0) if axis == 0 else (0.0 if side > 0 else np.pi)
                    spots.append((x, y, angle))
    for x, y, angle in spots:
        if rng.uniform() < 0.12:
            continue
        out = float(rng.uniform(0.05, 0.35)) if rng.uniform() < 0.8 else float(rng.uniform(0.4, 0.7))
        local = middle + np.array([x + out * math.cos(angle), y + out * math.sin(angle)])
        sx, sy = table.to_scene(local[None])[0]
        yaw = table.pose[3] + angle + np.pi / 2 + spin(placement, 9.0 if out < 0.35 else 28.0)
        placement.put(room, name, placement.build(name), float(sx), float(sy), float(yaw), 0.0, 0.0, table)


def put_table(
    placement: Placement,
    room: Room,
    table_name: str,
    x: float,
    y: float,
    yaw: float,
    things: list[str],
    chair: str | None = None,
) -> Placed | None:
    """A table with chairs around it and things on it; None where something is in the way."""
    table = placement.put(room, table_name, placement.build(table_name), x, y, yaw, 0.0, 0.55)
    if table is None:
        return None
    put_chairs_around(placement, room, table, chair or str(placement.rng.choice(["chair", "office_chair"])))
    placement.on_top(room, table, things, 0.9, 5)
    return table


def middle_of(room: Room) -> Floats:
    """(2,) metres: the middle of the rectangle around a room."""
    return (room.outline.min(axis=0) + room.outline.max(axis=0)) / 2


def long_yaw(room: Room) -> float:
    """The yaw, radians, of x along the longer side of a room."""
    size = np.ptp(room.outline, axis=0)
    return 0.0 if size[0] >= size[1] else np.pi / 2


def put_stores(placement: Placement, room: Room, count: int, names: list[str] = STORES) -> None:
    """Shelves and cabinets along the walls, with things on them; small ones may stand in a row."""
    for _ in range(count):
        placed = placement.at_wall(
            room, any_of(placement, names), jitter_rad=0.02, off_m=float(placement.rng.uniform(0.0, 0.05))
        )
        if placed and placement.rng.uniform() < 0.8:
            placement.on_top(room, placed, SHELF_THINGS, 0.7, 4)


def put_plants(placement: Placement, room: Room, count: int) -> None:
    for _ in range(count):
        placement.at_wall(room, "plant", jitter_rad=1.0, off_m=0.08)


def put_sundries(placement: Placement, room: Room, names: list[str], at_most: int) -> None:
    for _ in range(int(placement.rng.integers(1, at_most + 1))):
        placement.at_wall(room, any_of(placement, names), jitter_rad=0.2, off_m=0.05)


def put_table_somewhere(
    placement: Placement, room: Room, table: str, things: list[str], chair: str | None = None
) -> None:
    low, high = room.outline.min(axis=0) + 1.0, room.outline.max(axis=0) - 1.0
    for _ in range(10):
        x, y = placement.rng.uniform(np.minimum(low, high), np.maximum(low, high))
        if put_table(placement, room, table, float(x), float(y), long_yaw(room) + spin(placement, 5), things, chair):
            return


def put_island(placement: Placement, room: Room, x: float, y: float, yaw: float, pairs: int) -> int:
    """Desks face to face in two rows; how many there were room for."""
    rng = placement.rng
    cos, sin = math.cos(yaw), math.sin(yaw)
    seed = int(rng.integers(0, 2**63))
    done = 0
    for k in range(pairs):
        for side in (1.0, -1.0):
            built = FURNITURE["desk"].build(np.random.default_rng(seed))
            low, high = built.mesh.bounds()
            width = float(high[0] - low[0]) + 0.03
            turned = yaw + (np.pi if side > 0 else 0.0) + spin(placement, 0.7)
            along, across = (k - (pairs - 1) / 2) * width, side * (float(high[1]) + 0.03)
            along += side * float(high[0] + low[0]) / 2
            place = (x + along * cos - across * sin, y + along * sin + across * cos)
            desk = placement.put(room, "desk", built, place[0], place[1], turned, 0.0, 0.005)
            if desk:
                done += 1
                put_workplace(placement, room, desk)
    return done


def put_seating(placement: Placement, room: Room, x: float, y: float, yaw: float) -> bool:
    """A low table with sofas and armchairs around it."""
    rng = placement.rng
    table = placement.put(room, "coffee_table", placement.build("coffee_table"), x, y, yaw, 0.0, 0.5)
    if table is None:
        return False
    half = np.ptp(table.built.mesh.bounds(), axis=0)[:2] / 2
    for k in range(4):
        name = (
            str(rng.choice(["sofa", "armchair", "armchair"]))
            if k % 2 == 0
            else str(rng.choice(["armchair", "sofa", "stool"]))
        )
        if k and rng.uniform() < 0.25:
            continue
        angle = k * np.pi / 2 - np.pi / 2
        out = half[1 - k % 2] + float(rng.uniform(0.75, 1.0))
        sx, sy = table.to_scene(np.array([[out * math.cos(angle), out * math.sin(angle)]]))[0]
        seat = placement.put(
            room,
            name,
            placement.build(name),
            float(sx),
            float(sy),
            yaw + angle + np.pi / 2 + spin(placement, 7),
            0.0,
            0.02,
        )
        if seat and name == "sofa":
            placement.on_top(room, seat, ["cushion", "cushion", "backpack"], 0.7, 3)
    placement.on_top(room, table, TABLE_THINGS, 0.9, 4)
    return True


def put_seating_somewhere(placement: Placement, room: Room, tries: int = 10) -> None:
    low, high = room.outline.min(axis=0) + 1.2, room.outline.max(axis=0) - 1.2
    for _ in range(tries):
        x, y = placement.rng.uniform(np.minimum(low, high), np.maximum(low, high))
        yaw = float(placement.rng.integers(0, 4)) * np.pi / 2 + spin(placement, 6)
        if put_seating(placement, room, float(x), float(y), yaw):
            return
