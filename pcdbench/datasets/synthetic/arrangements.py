"""How rooms are furnished: what stands where in an office, a kitchen, a lobby, and what lies on it."""

from __future__ import annotations

from collections.abc import Callable

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
KITCHEN_THINGS = ["coffee_machine", "microwave", "kettle", "bowl", "bottle", "mug", "vase"]
SHELF_THINGS = ["book_row", "book_pile", "small_box", "vase", "bowl", "desk_plant", "paper_stack", "desktop_printer"]
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
STORES = ["bookcase", "cabinet", "filing_cabinet", "wardrobe", "open_rack", "bookcase"]


def furnish(placement: Placement, room: Room) -> None:
    """Furnish a room after its use."""
    _windows(placement, room)
    _MAKERS[room.use](placement, room)
    _walls(placement, room)
    _ceiling(placement, room)
    area = float(np.prod(np.ptp(room.outline, axis=0)))
    _clutter(placement, room, int(placement.rng.integers(2, 5 + int(area / 9))))


def _any(placement: Placement, names: list[str]) -> str:
    return str(placement.rng.choice(names))


def _spin(placement: Placement, degrees: float) -> float:
    return float(np.radians(placement.rng.normal(0.0, degrees)))


def _workplace(placement: Placement, room: Room, desk: Placed) -> None:
    """A chair at a desk, not quite straight, and what is on the desk."""
    rng = placement.rng
    low, high = desk.built.mesh.bounds()
    out = float(
        rng.choice([rng.uniform(0.1, 0.25), rng.uniform(0.3, 0.45), rng.uniform(0.5, 0.8)], p=[0.35, 0.45, 0.2])
    )
    turned = desk.pose[3] + _spin(placement, 30.0 if out > 0.25 else 10.0)
    x, y = desk.to_scene(np.array([[rng.normal(0.0, 0.08), low[1] - out]]))[0]
    placement.put(room, "office_chair", placement.build("office_chair"), float(x), float(y), turned, 0.0, 0.0, desk)
    top = desk.built.tops[0]
    for _ in range(int(rng.choice([1, 1, 2]))):
        x, y = desk.to_scene(
            np.array([[top.center[0] + rng.uniform(-0.35, 0.35), top.center[1] + top.size[1] * 0.22]])
        )[0]
        yaw = desk.pose[3] + np.pi + _spin(placement, 12.0)
        placement.put(room, "monitor", placement.build("monitor"), float(x), float(y), yaw, top.z + 0.002, 0.01, desk)
    x, y = desk.to_scene(np.array([[top.center[0] + rng.normal(0, 0.06), top.center[1] - top.size[1] * 0.28]]))[0]
    placement.put(
        room,
        "keyboard",
        placement.build("keyboard"),
        float(x),
        float(y),
        desk.pose[3] + _spin(placement, 6),
        top.z + 0.002,
        0.0,
        desk,
    )
    placement.on_top(room, desk, DESK_THINGS, 0.9, 6)


def _chairs_around(placement: Placement, room: Room, table: Placed, name: str, ends: bool = True) -> None:
    """Chairs on all sides of a table, some pulled out, some missing."""
    rng = placement.rng
    low, high = table.built.mesh.bounds()
    half, middle = (high - low)[:2] / 2, (high + low)[:2] / 2
    is_round = abs(half[0] - half[1]) < 0.12
    spots = []
    if is_round:
        count = max(3, int(2 * np.pi * half[0] / 0.85))
        for angle in np.arange(count) * 2 * np.pi / count + rng.uniform(0, 6):
            spots.append((half[0] * np.cos(angle), half[0] * np.sin(angle), angle))
    else:
        for axis in (0, 1):
            if axis == 1 and not ends:
                continue
            count = max(1, int(2 * half[axis] / 0.72))
            for k in range(count):
                along = (k - (count - 1) / 2) * 2 * half[axis] / count
                for side in (-1.0, 1.0):
                    x, y = (along, side * half[1]) if axis == 0 else (side * half[0], along)
                    angle = np.arctan2(side, 0.0) if axis == 0 else (0.0 if side > 0 else np.pi)
                    spots.append((x, y, angle))
    for x, y, angle in spots:
        if rng.uniform() < 0.12:
            continue
        out = float(rng.uniform(0.05, 0.35)) if rng.uniform() < 0.8 else float(rng.uniform(0.4, 0.7))
        local = middle + [x + out * np.cos(angle), y + out * np.sin(angle)]
        sx, sy = table.to_scene(local[None])[0]
        yaw = table.pose[3] + angle + np.pi / 2 + _spin(placement, 9.0 if out < 0.35 else 28.0)
        placement.put(room, name, placement.build(name), float(sx), float(sy), float(yaw), 0.0, 0.0, table)


def _table_group(
    placement: Placement,
    room: Room,
    table_name: str,
    x: float,
    y: float,
    yaw: float,
    things: list[str],
    chair: str | None = None,
) -> Placed | None:
    table = placement.put(room, table_name, placement.build(table_name), x, y, yaw, 0.0, 0.55)
    if table is None:
        return None
    _chairs_around(placement, room, table, chair or str(placement.rng.choice(["chair", "office_chair"])))
    placement.on_top(room, table, things, 0.9, 5)
    return table


def _middle(room: Room) -> Floats:
    return (room.outline.min(axis=0) + room.outline.max(axis=0)) / 2


def _long_yaw(room: Room) -> float:
    size = np.ptp(room.outline, axis=0)
    return 0.0 if size[0] >= size[1] else np.pi / 2


def _stores(placement: Placement, room: Room, count: int, names: list[str] = STORES) -> None:
    """Shelves and cabinets along the walls, with things on them; small ones may stand in a row."""
    for _ in range(count):
        placed = placement.at_wall(
            room, _any(placement, names), jitter_rad=0.02, off_m=float(placement.rng.uniform(0.0, 0.05))
        )
        if placed and placement.rng.uniform() < 0.8:
            placement.on_top(room, placed, SHELF_THINGS, 0.7, 4)


def _walls(placement: Placement, room: Room) -> None:
    perimeter = float(np.hypot(*(np.roll(room.outline, -1, axis=0) - room.outline).T).sum())
    for _ in range(int(placement.rng.integers(4, 6 + int(perimeter / 3.5)))):
        placement.at_wall(room, _any(placement, WALL_THINGS), off_m=0.0, tries=6)


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
        name = _any(placement, CEILING_THINGS)
        x, y = rng.uniform(low, high)
        placement.put(room, name, placement.build(name), float(x), float(y), _long_yaw(room), room.height - 0.001, 0.02)


def _clutter(placement: Placement, room: Room, count: int) -> None:
    for _ in range(count):
        name = _any(placement, CLUTTER)
        if placement.rng.uniform() < 0.7:
            placement.at_wall(room, name, jitter_rad=0.3, off_m=float(placement.rng.uniform(0.02, 0.15)))
        else:
            placement.somewhere(room, name, 5, 0.1)


def _plants(placement: Placement, room: Room, count: int) -> None:
    for _ in range(count):
        placement.at_wall(room, "plant", jitter_rad=1.0, off_m=0.08)


def _office(placement: Placement, room: Room) -> None:
    rng = placement.rng
    area = float(np.prod(np.ptp(room.outline, axis=0)))
    wanted = max(1, min(6, int(area / 6.5)))
    done = 0
    if wanted >= 2 and rng.uniform() < 0.6:
        x, y = _middle(room) + rng.normal(0, 0.25, 2)
        done += _island(
            placement,
            room,
            float(x),
            float(y),
            _long_yaw(room) + (np.pi / 2 if rng.uniform() < 0.4 else 0.0),
            min(3, (wanted + 1) // 2),
        )
    for _ in range(wanted + 1):
        if done >= wanted:
            break
        desk = placement.at_wall(room, "desk", tries=14, off_m=float(rng.uniform(0.02, 0.1)), gap=0.25, flipped=True)
        if desk:
            done += 1
            _workplace(placement, room, desk)
    _stores(placement, room, int(rng.integers(3, 7)))
    if area > 17 and rng.uniform() < 0.6:
        _group_somewhere(placement, room, "round_table", TABLE_THINGS)
    _plants(placement, room, int(rng.integers(0, 3)))
    _sundries(placement, room, ["coat_stand", "floor_lamp", "printer", "whiteboard_stand", "waste_bin"], 2)


def _sundries(placement: Placement, room: Room, names: list[str], at_most: int) -> None:
    for _ in range(int(placement.rng.integers(1, at_most + 1))):
        placement.at_wall(room, _any(placement, names), jitter_rad=0.2, off_m=0.05)


def _group_somewhere(placement: Placement, room: Room, table: str, things: list[str], chair: str | None = None) -> None:
    low, high = room.outline.min(axis=0) + 1.0, room.outline.max(axis=0) - 1.0
    for _ in range(10):
        x, y = placement.rng.uniform(np.minimum(low, high), np.maximum(low, high))
        if _table_group(
            placement, room, table, float(x), float(y), _long_yaw(room) + _spin(placement, 5), things, chair
        ):
            return


def _island(placement: Placement, room: Room, x: float, y: float, yaw: float, pairs: int) -> int:
    """Desks face to face in two rows; how many there were room for."""
    rng = placement.rng
    cos, sin = np.cos(yaw), np.sin(yaw)
    seed = int(rng.integers(0, 2**63))
    done = 0
    for k in range(pairs):
        for side in (1.0, -1.0):
            built = FURNITURE["desk"].build(np.random.default_rng(seed))
            low, high = built.mesh.bounds()
            width = float(high[0] - low[0]) + 0.03
            turned = yaw + (np.pi if side > 0 else 0.0) + _spin(placement, 0.7)
            along, across = (k - (pairs - 1) / 2) * width, side * (float(high[1]) + 0.03)
            along += side * float(high[0] + low[0]) / 2
            place = (x + along * cos - across * sin, y + along * sin + across * cos)
            desk = placement.put(room, "desk", built, *place, turned, 0.0, 0.005)
            if desk:
                done += 1
                _workplace(placement, room, desk)
    return done


def _meeting(placement: Placement, room: Room) -> None:
    rng = placement.rng
    x, y = _middle(room) + rng.normal(0, 0.2, 2)
    name = "round_table" if rng.uniform() < 0.2 else "meeting_table"
    for attempt in range(6):
        yaw = _long_yaw(room) + (np.pi / 2 if attempt % 2 else 0.0) + _spin(placement, 2.0)
        place = (x, y) if attempt < 3 else (x + rng.normal(0, 0.5), y + rng.normal(0, 0.5))
        if _table_group(placement, room, name, float(place[0]), float(place[1]), yaw, TABLE_THINGS):
            break
        name = name if attempt < 2 else "round_table"
    placement.at_wall(room, _any(placement, ["wall_whiteboard", "wall_screen", "notice_board"]), off_m=0.0)
    placement.at_wall(room, _any(placement, ["wall_screen", "projector_screen", "wall_whiteboard"]), off_m=0.0)
    _stores(placement, room, int(rng.integers(2, 5)), ["filing_cabinet", "cabinet", "bookcase"])
    _plants(placement, room, int(rng.integers(0, 3)))
    _sundries(placement, room, ["whiteboard_stand", "coat_stand", "waste_bin", "chair", "podium"], 3)


def _classroom(placement: Placement, room: Room) -> None:
    """Rows of tables towards the board on a short wall."""
    rng = placement.rng
    low, high = room.outline.min(axis=0), room.outline.max(axis=0)
    front = _long_yaw(room) - np.pi / 2 if rng.uniform() < 0.5 else _long_yaw(room) + np.pi / 2
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
                *map(float, at),
                front + _spin(placement, 2.5),
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
                        table.pose[3] + _spin(placement, 12),
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
        room, "desk", placement.build("desk"), *map(float, at), front + np.pi + _spin(placement, 4), 0.0, 0.1
    )
    if desk:
        _workplace(placement, room, desk)
    _stores(placement, room, int(rng.integers(2, 5)))
    _sundries(placement, room, ["podium", "waste_bin", "plant", "coat_stand"], 3)


def _kitchen(placement: Placement, room: Room) -> None:
    """Units in a row along a wall, then tables."""
    rng = placement.rng
    for name in ("kitchen_counter", "kitchen_counter", "fridge", "dishwasher"):
        placed = placement.at_wall(room, name, tries=30)
        if placed:
            placement.on_top(room, placed, KITCHEN_THINGS, 1.0, 4)
    area = float(np.prod(np.ptp(room.outline, axis=0)))
    for _ in range(max(1, int(area / 14))):
        _group_somewhere(
            placement,
            room,
            str(rng.choice(["dining_table", "round_table"])),
            KITCHEN_THINGS[3:] + ["vase", "bowl"],
            "chair",
        )
    _sundries(placement, room, ["water_cooler", "vending_machine", "waste_bin", "plant"], 3)
    _stores(placement, room, 1, ["cabinet", "filing_cabinet", "open_rack"])


def _seating(placement: Placement, room: Room, x: float, y: float, yaw: float) -> bool:
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
        sx, sy = table.to_scene(np.array([[out * np.cos(angle), out * np.sin(angle)]]))[0]
        seat = placement.put(
            room,
            name,
            placement.build(name),
            float(sx),
            float(sy),
            yaw + angle + np.pi / 2 + _spin(placement, 7),
            0.0,
            0.02,
        )
        if seat and name == "sofa":
            placement.on_top(room, seat, ["cushion", "cushion", "backpack"], 0.7, 3)
    placement.on_top(room, table, TABLE_THINGS, 0.9, 4)
    return True


def _seating_somewhere(placement: Placement, room: Room, tries: int = 10) -> None:
    low, high = room.outline.min(axis=0) + 1.2, room.outline.max(axis=0) - 1.2
    for _ in range(tries):
        x, y = placement.rng.uniform(np.minimum(low, high), np.maximum(low, high))
        yaw = float(placement.rng.integers(0, 4)) * np.pi / 2 + _spin(placement, 6)
        if _seating(placement, room, float(x), float(y), yaw):
            return


def _lounge(placement: Placement, room: Room) -> None:
    rng = placement.rng
    area = float(np.prod(np.ptp(room.outline, axis=0)))
    for _ in range(max(1, int(area / 16))):
        _seating_somewhere(placement, room)
    for _ in range(2):
        sofa = placement.at_wall(room, "sofa", off_m=0.05)
        if sofa:
            placement.on_top(room, sofa, ["cushion"], 0.8, 3)
    _stores(placement, room, int(rng.integers(2, 5)), ["bookcase", "filing_cabinet", "cabinet"])
    if rng.uniform() < 0.5:
        _group_somewhere(placement, room, "round_table", TABLE_THINGS)
    _plants(placement, room, int(rng.integers(1, 4)))
    _sundries(placement, room, ["floor_lamp", "tv_stand", "vending_machine", "coat_stand", "partition"], 3)


def _storage(placement: Placement, room: Room) -> None:
    rng = placement.rng
    _stores(
        placement,
        room,
        int(rng.integers(4, 8)),
        ["open_rack", "open_rack", "cabinet", "bookcase", "filing_cabinet", "lockers"],
    )
    for _ in range(int(rng.integers(1, 3))):
        placed = placement.somewhere(room, "open_rack", 8, 0.7, _long_yaw(room))
        if placed:
            placement.on_top(room, placed, SHELF_THINGS, 0.9, 5)
    for _ in range(int(rng.integers(4, 9))):
        name = _any(placement, ["crate", "box_stack", "bicycle", "server_rack", "box_stack", "chair"])
        placement.at_wall(room, name, jitter_rad=0.4, off_m=0.05)
    for _ in range(3):
        placement.somewhere(room, _any(placement, ["crate", "box_stack", "stool"]), 5, 0.25)


def _corridor(placement: Placement, room: Room) -> None:
    rng = placement.rng
    length = float(np.ptp(room.outline, axis=0).max())
    for _ in range(int(rng.integers(3, 4 + int(length / 1.8)))):
        name = _any(
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
        placement.at_wall(room, _any(placement, ["fire_extinguisher", "notice_board"]), off_m=0.0)


def _hallway(placement: Placement, room: Room) -> None:
    _corridor(placement, room)
    rng = placement.rng
    for _ in range(int(rng.integers(5, 10))):
        placement.at_wall(room, _any(placement, ["lockers", "lockers", "bench", "bookcase"]), off_m=0.02)
    for _ in range(int(rng.integers(1, 4))):
        _seating_somewhere(placement, room, 5)
    for _ in range(int(rng.integers(1, 3))):
        _group_somewhere(placement, room, "round_table", TABLE_THINGS, "chair")
    _plants(placement, room, 3)


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
                    yaw + _spin(placement, 30),
                    0.0,
                    0.0,
                )
            placement.on_top(room, counter, ["monitor", "book_pile", "paper_stack", "vase", "telephone"], 1.0, 4)
            break
    area = float(np.prod(high - low))
    for _ in range(int(area / 20)):
        _seating_somewhere(placement, room, 6)
    for _ in range(int(area / 30)):
        _group_somewhere(placement, room, "round_table", TABLE_THINGS)
    for _ in range(4):
        placement.at_wall(
            room,
            _any(placement, ["bench", "bookcase", "vending_machine", "bookcase", "filing_cabinet", "tv_stand"]),
            off_m=0.03,
        )
    _plants(placement, room, int(rng.integers(3, 7)))
    for _ in range(4):
        placement.somewhere(
            room, _any(placement, ["plant", "umbrella_stand", "waste_bin", "partition", "bench"]), 6, 0.5
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
                _island(placement, room, float(at[0]), float(at[1]), np.pi / 2 if upright else 0.0, pairs)
            elif draw < 0.84:
                _seating(placement, room, float(at[0]), float(at[1]), float(rng.integers(0, 2)) * np.pi / 2)
            else:
                _table_group(placement, room, "meeting_table", float(at[0]), float(at[1]), 0.0, TABLE_THINGS)
    _stores(placement, room, int(rng.integers(8, 14)))
    for _ in range(int(rng.integers(6, 13))):
        placement.somewhere(
            room,
            _any(placement, ["partition", "filing_cabinet", "plant", "filing_cabinet", "whiteboard_stand"]),
            6,
            0.35,
            float(rng.integers(0, 4)) * np.pi / 2,
        )
    _plants(placement, room, int(rng.integers(3, 6)))
    _sundries(placement, room, ["printer", "coat_stand", "water_cooler", "vending_machine"], 4)


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
