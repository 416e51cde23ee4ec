"""How rooms are furnished: what stands where in an office, a kitchen, a lobby, and what lies on it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pcdbench.datasets.synthetic.fittings import put_at_windows, put_clutter, put_on_ceiling, put_on_walls
from pcdbench.datasets.synthetic.groups import (
    SHELF_THINGS,
    TABLE_THINGS,
    any_of,
    long_yaw,
    middle_of,
    put_island,
    put_plants,
    put_seating_somewhere,
    put_stores,
    put_sundries,
    put_table,
    put_table_somewhere,
    put_workplace,
    spin,
)
from pcdbench.datasets.synthetic.open_spaces import furnish_corridor, furnish_hallway, furnish_lobby, furnish_open_plan
from pcdbench.datasets.synthetic.placement import Placement
from pcdbench.datasets.synthetic.plan import Room

KITCHEN_THINGS = ["coffee_machine", "microwave", "kettle", "bowl", "bottle", "mug", "vase"]


def furnish(placement: Placement, room: Room) -> None:
    """Furnish a room after its use."""
    put_at_windows(placement, room)
    _MAKERS[room.use](placement, room)
    put_on_walls(placement, room)
    put_on_ceiling(placement, room)
    area = float(np.prod(np.ptp(room.outline, axis=0)))
    put_clutter(placement, room, int(placement.rng.integers(2, 5 + int(area / 9))))


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
    ahead = np.array([-math.sin(front), math.cos(front)])
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


_MAKERS: dict[str, Callable[[Placement, Room], None]] = {
    "office": _office,
    "meeting": _meeting,
    "classroom": _classroom,
    "kitchen": _kitchen,
    "lounge": _lounge,
    "storage": _storage,
    "corridor": furnish_corridor,
    "hallway": furnish_hallway,
    "lobby": furnish_lobby,
    "open_plan": furnish_open_plan,
}
