"""How rooms are furnished: what stands where in an office, a kitchen, a lobby, and what lies on it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pcdbench.datasets.synthetic.groups import (
    SHELF_THINGS,
    TABLE_THINGS,
    any_of,
    long_yaw,
    middle_of,
    put_island,
    put_plants,
    put_seating,
    put_seating_somewhere,
    put_stores,
    put_sundries,
    put_table,
    put_table_somewhere,
    put_workplace,
    spin,
)
from pcdbench.datasets.synthetic.placement import Placement
from pcdbench.datasets.synthetic.plan import Floats, Room

KITCHEN_THINGS = ["coffee_machine", "microwave", "kettle", "bowl", "bottle", "mug", "vase"]
CLUTTER = [
    "crate",
    "backpack",
    "waste_bin",
    "box_stack",
    "shoes",
    "umbrella_stand",
    "stool",
    "backpack",
    "waste_bin",
    "bicycle",
    "pedestal",
]
WALL_THINGS = [
    "picture",
    "picture",
    "clock",
    "notice_board",
    "wall_whiteboard",
    "wall_shelf",
    "wall_shelf",
    "wall_sign",
    "wall_lamp",
    "wall_grille",
    "wall_cabinet",
    "wall_air_conditioner",
    "wall_mirror",
    "radiator",
    "fire_extinguisher",
]
CEILING_THINGS = ["smoke_detector", "sprinkler", "cassette_unit", "ceiling_grille", "hanging_sign", "projector"]


def furnish(placement: Placement, room: Room) -> None:
    """Furnish a room after its use."""
    _windows(placement, room)
    _MAKERS[room.use](placement, room)
    _walls(placement, room)
    _ceiling(placement, room)
    area = float(np.prod(np.ptp(room.outline, axis=0)))
    _clutter(placement, room, int(placement.rng.integers(2, 5 + int(area / 9))))


def _walls(placement: Placement, room: Room) -> None:
    perimeter = float(np.hypot(*(np.roll(room.outline, -1, axis=0) - room.outline).T).sum())
    for _ in range(int(placement.rng.integers(4, 6 + int(perimeter / 3.5)))):
        placement.at_wall(room, any_of(placement, WALL_THINGS), off_m=0.0, tries=6)


def _windows(placement: Placement, room: Room) -> None:
    """Radiators under windows, and curtains beside them in some rooms."""
    curtains = placement.rng.uniform() < 0.35
    for start, end in room.edges():
        for first, last, opening in placement.plan.openings_of(start, end):
            if opening.kind != "window":
                continue
            if opening.z0 > 0.7 and placement.rng.uniform() < 0.75:
                _centered(placement, room, "radiator", start, end, (first + last) / 2)
            if curtains and placement.rng.uniform() < 0.8:
                _centered(placement, room, "curtain", start, end, (first + last) / 2)


def _centered(placement: Placement, room: Room, name: str, start: Floats, end: Floats, middle: float) -> None:
    """Put a wall piece in front of the middle of a wall's interval, whatever is in the wall there."""
    along = (end - start) / np.hypot(*(end - start))
    x, y = start + along * middle + np.array([-along[1], along[0]]) * 0.01
    placement.put(room, name, placement.build(name), float(x), float(y), float(np.arctan2(along[1], along[0])))


def _ceiling(placement: Placement, room: Room) -> None:
    rng = placement.rng
    low, high = room.outline.min(axis=0), room.outline.max(axis=0)
    for _ in range(int(rng.integers(0, 3 + int(np.prod(high - low) / 10)))):
        name = any_of(placement, CEILING_THINGS)
        x, y = rng.uniform(low, high)
        placement.put(room, name, placement.build(name), float(x), float(y), long_yaw(room), room.height - 0.001, 0.02)


def _clutter(placement: Placement, room: Room, count: int) -> None:
    for _ in range(count):
        name = any_of(placement, CLUTTER)
        if placement.rng.uniform() < 0.7:
            placement.at_wall(room, name, jitter_rad=0.3, off_m=float(placement.rng.uniform(0.02, 0.15)))
        else:
            placement.somewhere(room, name, 5, 0.1)


def _office(placement: Placement, room: Room) -> None:
    rng = placement.rng
    area = float(np.prod(np.ptp(room.outline, axis=0)))
    wanted = max(1, min(6, int(area / 6.5)))
    done = 0
    if wanted >= 2 and rng.uniform() < 0.6:
        x, y = middle_of(room) + rng.normal(0, 0.25, 2)
        done += put_island(
            placement,
            room,
            float(x),
            float(y),
            long_yaw(room) + (np.pi / 2 if rng.uniform() < 0.4 else 0.0),
            min(3, (wanted + 1) // 2),
        )
    for _ in range(wanted + 1):
        if done >= wanted:
            break
        desk = placement.at_wall(room, "desk", tries=14, off_m=float(rng.uniform(0.02, 0.1)), gap=0.25, flipped=True)
        if desk:
            done += 1
            put_workplace(placement, room, desk)
    put_stores(placement, room, int(rng.integers(3, 7)))
    if area > 17 and rng.uniform() < 0.6:
        put_table_somewhere(placement, room, "round_table", TABLE_THINGS)
    put_plants(placement, room, int(rng.integers(0, 3)))
    put_sundries(placement, room, ["coat_stand", "floor_lamp", "printer", "whiteboard_stand", "waste_bin"], 2)


def _meeting(placement: Placement, room: Room) -> None:
    rng = placement.rng
    x, y = middle_of(room) + rng.normal(0, 0.2, 2)
    name = "round_table" if rng.uniform() < 0.2 else "meeting_table"
    for attempt in range(6):
        yaw = long_yaw(room) + (np.pi / 2 if attempt % 2 else 0.0) + spin(placement, 2.0)
        place = (x, y) if attempt < 3 else (x + rng.normal(0, 0.5), y + rng.normal(0, 0.5))
        if put_table(placement, room, name, float(place[0]), float(place[1]), yaw, TABLE_THINGS):
            break
        name = name if attempt < 2 else "round_table"
    placement.at_wall(room, any_of(placement, ["wall_whiteboard", "wall_screen", "notice_board"]), off_m=0.0)
    placement.at_wall(room, any_of(placement, ["wall_screen", "projector_screen", "wall_whiteboard"]), off_m=0.0)
    put_stores(placement, room, int(rng.integers(2, 5)), ["filing_cabinet", "cabinet", "bookcase"])
    put_plants(placement, room, int(rng.integers(0, 3)))
    put_sundries(placement, room, ["whiteboard_stand", "coat_stand", "waste_bin", "chair", "podium"], 3)


def _classroom(placement: Placement, room: Room) -> None:
    """Rows of tables towards the board on a short wall."""
    rng = placement.rng
    low, high = room.outline.min(axis=0), room.outline.max(axis=0)
    front = long_yaw(room) - np.pi / 2 if rng.uniform() < 0.5 else long_yaw(room) + np.pi / 2
    ahead = np.array([-np.sin(front), np.cos(front)])
    size = abs(ahead @ (high - low)), abs(np.array([ahead[1], -ahead[0]]) @ (high - low))
    side = np.array([ahead[1], -ahead[0]])
    middle = (low + high) / 2
    columns = max(1, int((size[1] - 1.2) // 2.1))
    for row in range(max(1, int((size[0] - 2.6) // 1.4))):
        for column in range(columns):
            at = middle + ahead * (size[0] / 2 - 2.9 - 1.4 * row) + side * (column - (columns - 1) / 2) * 2.1
            at += rng.normal(0, 0.05, 2)
            table = placement.put(
                room,
                "dining_table",
                placement.build("dining_table"),
                float(at[0]),
                float(at[1]),
                front + spin(placement, 2.5),
                0.0,
                0.1,
            )
            if table is None:
                continue
            depth = float(table.built.mesh.bounds()[0][1])
            for k in (-0.36, 0.36):
                if rng.uniform() < 0.88:
                    out = float(rng.choice([rng.uniform(0.05, 0.25), rng.uniform(0.3, 0.5)], p=[0.7, 0.3]))
                    sx, sy = table.to_scene(np.array([[k + rng.normal(0, 0.04), depth - out]]))[0]
                    placement.put(
                        room,
                        "chair",
                        placement.build("chair"),
                        float(sx),
                        float(sy),
                        table.pose[3] + spin(placement, 12),
                        0.0,
                        0.0,
                        table,
                    )
            placement.on_top(room, table, ["book_pile", "paper_stack", "bottle", "pen_cup", "laptop"], 0.8, 3)
    for start, end in room.edges():
        along = (end - start) / np.hypot(*(end - start))
        inward = np.array([-along[1], along[0]])
        if inward @ ahead < -0.99:
            board = placement.build("wall_whiteboard")
            width = float(np.ptp(board.mesh.bounds(), axis=0)[0])
            placement.on_wall(
                room, "wall_whiteboard", board, start, end, (float(np.hypot(*(end - start))) - width) / 2, off_m=0.0
            )
    at = middle + ahead * (size[0] / 2 - 1.25) + side * float(rng.uniform(-1.5, 1.5))
    desk = placement.put(
        room, "desk", placement.build("desk"), float(at[0]), float(at[1]), front + np.pi + spin(placement, 4), 0.0, 0.1
    )
    if desk:
        put_workplace(placement, room, desk)
    put_stores(placement, room, int(rng.integers(2, 5)))
    put_sundries(placement, room, ["podium", "waste_bin", "plant", "coat_stand"], 3)


def _kitchen(placement: Placement, room: Room) -> None:
    """Units in a row along a wall, then tables."""
    rng = placement.rng
    for name in ("kitchen_counter", "kitchen_counter", "fridge", "dishwasher"):
        placed = placement.at_wall(room, name, tries=30)
        if placed:
            placement.on_top(room, placed, KITCHEN_THINGS, 1.0, 4)
    area = float(np.prod(np.ptp(room.outline, axis=0)))
    for _ in range(max(1, int(area / 14))):
        put_table_somewhere(
            placement,
            room,
            str(rng.choice(["dining_table", "round_table"])),
            [*KITCHEN_THINGS[3:], "bowl"],
            "chair",
        )
    put_sundries(placement, room, ["water_cooler", "vending_machine", "waste_bin", "plant"], 3)
    put_stores(placement, room, 1, ["cabinet", "filing_cabinet", "open_rack"])


def _lounge(placement: Placement, room: Room) -> None:
    rng = placement.rng
    area = float(np.prod(np.ptp(room.outline, axis=0)))
    for _ in range(max(1, int(area / 16))):
        put_seating_somewhere(placement, room)
    for _ in range(2):
        sofa = placement.at_wall(room, "sofa", off_m=0.05)
        if sofa:
            placement.on_top(room, sofa, ["cushion"], 0.8, 3)
    put_stores(placement, room, int(rng.integers(2, 5)), ["bookcase", "filing_cabinet", "cabinet"])
    if rng.uniform() < 0.5:
        put_table_somewhere(placement, room, "round_table", TABLE_THINGS)
    put_plants(placement, room, int(rng.integers(1, 4)))
    put_sundries(placement, room, ["floor_lamp", "tv_stand", "vending_machine", "coat_stand", "partition"], 3)


def _storage(placement: Placement, room: Room) -> None:
    rng = placement.rng
    put_stores(
        placement,
        room,
        int(rng.integers(4, 8)),
        ["open_rack", "open_rack", "cabinet", "bookcase", "filing_cabinet", "lockers"],
    )
    for _ in range(int(rng.integers(1, 3))):
        placed = placement.somewhere(room, "open_rack", 8, 0.7, long_yaw(room))
        if placed:
            placement.on_top(room, placed, SHELF_THINGS, 0.9, 5)
    for _ in range(int(rng.integers(4, 9))):
        name = any_of(placement, ["crate", "box_stack", "bicycle", "server_rack", "box_stack", "chair"])
        placement.at_wall(room, name, jitter_rad=0.4, off_m=0.05)
    for _ in range(3):
        placement.somewhere(room, any_of(placement, ["crate", "box_stack", "stool"]), 5, 0.25)


def _corridor(placement: Placement, room: Room) -> None:
    rng = placement.rng
    length = float(np.ptp(room.outline, axis=0).max())
    for _ in range(int(rng.integers(3, 4 + int(length / 1.8)))):
        name = any_of(
            placement,
            [
                "bench",
                "cabinet",
                "lockers",
                "plant",
                "printer",
                "bookcase",
                "chair",
                "water_cooler",
                "filing_cabinet",
                "filing_cabinet",
            ],
        )
        placed = placement.at_wall(room, name, off_m=0.03, jitter_rad=0.03)
        if placed:
            placement.on_top(room, placed, ["book_pile", "paper_stack", "desk_plant", "small_box"], 0.5, 3)
    for _ in range(2):
        placement.at_wall(room, any_of(placement, ["fire_extinguisher", "notice_board"]), off_m=0.0)


def _hallway(placement: Placement, room: Room) -> None:
    _corridor(placement, room)
    rng = placement.rng
    for _ in range(int(rng.integers(5, 10))):
        placement.at_wall(room, any_of(placement, ["lockers", "lockers", "bench", "bookcase"]), off_m=0.02)
    for _ in range(int(rng.integers(1, 4))):
        put_seating_somewhere(placement, room, 5)
    for _ in range(int(rng.integers(1, 3))):
        put_table_somewhere(placement, room, "round_table", TABLE_THINGS, "chair")
    put_plants(placement, room, 3)


def _lobby(placement: Placement, room: Room) -> None:
    rng = placement.rng
    low, high = room.outline.min(axis=0), room.outline.max(axis=0)
    for _ in range(10):
        x, y = rng.uniform(low + 2.0, high - 2.0)
        yaw = float(rng.integers(0, 4)) * np.pi / 2
        counter = placement.put(
            room, "reception_counter", placement.build("reception_counter"), float(x), float(y), yaw, 0.0, 0.9
        )
        if counter:
            for dx in (-0.5, 0.6):
                sx, sy = counter.to_scene(np.array([[dx, counter.built.mesh.bounds()[0][1] - 0.35]]))[0]
                placement.put(
                    room,
                    "office_chair",
                    placement.build("office_chair"),
                    float(sx),
                    float(sy),
                    yaw + spin(placement, 30),
                    0.0,
                    0.0,
                )
            placement.on_top(room, counter, ["monitor", "book_pile", "paper_stack", "vase", "telephone"], 1.0, 4)
            break
    area = float(np.prod(high - low))
    for _ in range(int(area / 20)):
        put_seating_somewhere(placement, room, 6)
    for _ in range(int(area / 30)):
        put_table_somewhere(placement, room, "round_table", TABLE_THINGS)
    for _ in range(4):
        placement.at_wall(
            room,
            any_of(placement, ["bench", "bookcase", "vending_machine", "bookcase", "filing_cabinet", "tv_stand"]),
            off_m=0.03,
        )
    put_plants(placement, room, int(rng.integers(3, 7)))
    for _ in range(4):
        placement.somewhere(
            room, any_of(placement, ["plant", "umbrella_stand", "waste_bin", "partition", "bench"]), 6, 0.5
        )


def _open_plan(placement: Placement, room: Room) -> None:
    rng = placement.rng
    low, high = room.outline.min(axis=0), room.outline.max(axis=0)
    size = high - low
    pairs = int(rng.integers(2, 4))
    step = np.array([pairs * 1.62 + 1.1, 3.7])
    counts = np.maximum(1, ((size - 1.0) // step).astype(int))
    upright = bool(rng.uniform() < 0.3)
    step = step[::-1] if upright else step
    for i in range(counts[0]):
        for j in range(counts[1]):
            at = low + size * (np.array([i, j]) + 0.5) / counts + rng.normal(0, 0.15, 2)
            draw = rng.uniform()
            if draw < 0.72:
                put_island(placement, room, float(at[0]), float(at[1]), np.pi / 2 if upright else 0.0, pairs)
            elif draw < 0.84:
                put_seating(placement, room, float(at[0]), float(at[1]), float(rng.integers(0, 2)) * np.pi / 2)
            else:
                put_table(placement, room, "meeting_table", float(at[0]), float(at[1]), 0.0, TABLE_THINGS)
    put_stores(placement, room, int(rng.integers(8, 14)))
    for _ in range(int(rng.integers(6, 13))):
        placement.somewhere(
            room,
            any_of(placement, ["partition", "filing_cabinet", "plant", "filing_cabinet", "whiteboard_stand"]),
            6,
            0.35,
            float(rng.integers(0, 4)) * np.pi / 2,
        )
    put_plants(placement, room, int(rng.integers(3, 6)))
    put_sundries(placement, room, ["printer", "coat_stand", "water_cooler", "vending_machine"], 4)


_MAKERS: dict[str, Callable[[Placement, Room], None]] = {
    "office": _office,
    "meeting": _meeting,
    "classroom": _classroom,
    "kitchen": _kitchen,
    "lounge": _lounge,
    "storage": _storage,
    "corridor": _corridor,
    "hallway": _hallway,
    "lobby": _lobby,
    "open_plan": _open_plan,
}
