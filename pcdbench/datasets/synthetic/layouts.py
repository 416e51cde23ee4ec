"""The floor plans of each kind of environment, drawn at random."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pcdbench.datasets.synthetic.plan import (
    INNER_WALL_M,
    Opening,
    Plan,
    Room,
    bumped,
    connect,
    rectangle,
    windows,
    with_openings,
)
from pcdbench.datasets.synthetic.rooms import doors_to, random_height, room_of, row_of_rooms, shaped

Columns = tuple[tuple[float, float, float, bool], ...]

LARGE_KINDS = ("corridor", "lobby", "open_plan", "hallway", "corridor", "open_plan")
SMALL_KINDS = ("office", "meeting", "classroom", "kitchen", "office", "lounge", "meeting", "storage")

_SIDE_USES = ("office", "office", "meeting", "office", "storage", "kitchen", "lounge")


def plan_of(kind: str, rng: np.random.Generator) -> Plan:
    """A plan of one of the kinds in `LARGE_KINDS` or `SMALL_KINDS`."""
    makers: dict[str, Callable[[np.random.Generator], Plan]] = {
        "corridor": _corridor,
        "lobby": _lobby,
        "open_plan": _open_plan,
        "hallway": _hallway,
    }
    return makers[kind](rng) if kind in makers else _suite(kind, rng)


def _with_piers(room: Room, taken: Sequence[Opening], rng: np.random.Generator, chance: float) -> Room:
    """The room with piers or shafts set into long walls, clear of what is in the walls already."""
    outline = room.outline
    plan = Plan("", (), tuple(taken))
    for edge in range(len(room.outline) - 1, -1, -1):
        start, end = room.outline[edge], room.outline[(edge + 1) % len(room.outline)]
        length = float(np.hypot(*(end - start)))
        if length < 2.5 or rng.uniform() > chance:
            continue
        width, depth = float(rng.uniform(0.3, 0.9)), float(rng.uniform(0.12, 0.45))
        first = float(rng.uniform(0.4, length - width - 0.4))
        if all(first + width < a - 0.3 or first > b + 0.3 for a, b, _ in plan.openings_of(start, end)):
            outline = bumped(outline, edge, first, first + width, depth)
    return replace(room, outline=outline)


def _finished(
    kind: str,
    rooms: list[Room],
    openings: list[Opening | None],
    rng: np.random.Generator,
    columns: Columns = (),
) -> Plan:
    """The plan with windows in the outer walls and piers where there is room for them."""
    plan = Plan(kind, tuple(rooms), tuple(opening for opening in openings if opening is not None), columns)
    for room in rooms:
        plan = with_openings(plan, windows(plan, room, rng))
    with_piers = tuple(
        _with_piers(room, plan.openings, rng, 0.25 if room.use != "corridor" else 0.15) for room in rooms
    )
    return Plan(kind, with_piers, plan.openings, plan.columns)


def _corridor(rng: np.random.Generator) -> Plan:
    """A corridor with rooms on both sides, a branch and a widening at its end."""
    length, width = float(rng.uniform(19, 28)), float(rng.uniform(1.9, 2.9))
    up, down = float(rng.uniform(4.0, 5.6)), float(rng.uniform(3.6, 5.2))
    height = random_height(rng, 2.45, 2.9)
    at, branch = float(length * rng.uniform(0.3, 0.65)), float(rng.uniform(1.8, 2.6))
    w = INNER_WALL_M
    outline = np.array(
        [
            [0, 0],
            [length, 0],
            [length, width],
            [at + branch, width],
            [at + branch, width + up],
            [at, width + up],
            [at, width],
            [0, width],
        ],
        np.float64,
    )
    rooms = [room_of("corridor", outline, rng, height)]
    end_width = float(rng.uniform(4.5, 6.5))
    end = shaped(rectangle(length + w, -down * 0.6, length + w + end_width, width + up * 0.5), rng, (1, 2), 0.9)
    rooms.append(room_of(str(rng.choice(["lounge", "kitchen"])), end, rng, height + float(rng.uniform(0.0, 0.6))))
    side = len(rooms)
    rooms += row_of_rooms(0.0, at - w, width + w, up - w, True, _SIDE_USES, rng)
    rooms += row_of_rooms(at + branch + w, length - 0.5, width + w, up - w, True, _SIDE_USES, rng)
    rooms += row_of_rooms(0.0, length - 0.5, -w, down, False, _SIDE_USES, rng)
    openings = doors_to(rooms, 0, range(side, len(rooms)), rng, 0.3)
    openings.append(connect(rooms, 1, 0, "passage", min(1.6, width - 0.4), rng, 2.3))
    return _finished("corridor", rooms, openings, rng)


def _hallway(rng: np.random.Generator) -> Plan:
    """A wide school hallway: windows on one side, rooms on the other, wider and lower parts."""
    length, width = float(rng.uniform(18, 25)), float(rng.uniform(3.2, 4.8))
    depth = float(rng.uniform(5.0, 6.5))
    outline = shaped(rectangle(0, 0, length, width), rng, (0, 1), 1.2)
    step = float(length * rng.uniform(0.35, 0.6))
    edge = int(np.argmin(np.abs(outline[:, 1] - width) + np.where(np.roll(outline[:, 1], -1) == width, 0.0, 9.0)))
    outline = bumped(outline, edge, length - step - 3.0, length - step, -0.0 + float(rng.uniform(0.5, 0.9)))
    rooms = [room_of("hallway", outline, rng, random_height(rng, 2.9, 3.6))]
    w = INNER_WALL_M
    rooms += row_of_rooms(0.0, step, width + w, depth, True, ("classroom", "office", "storage"), rng)
    rooms += row_of_rooms(step + 3.0, length, width + w, depth, True, ("classroom", "lounge", "meeting"), rng)
    openings = doors_to(rooms, 0, range(1, len(rooms)), rng, 0.35)
    return _finished("hallway", rooms, openings, rng)


def _columns(low: tuple[float, float], high: tuple[float, float], rng: np.random.Generator) -> Columns:
    """Columns on a grid inside a rectangle, some metres off its walls."""
    half, is_round = float(rng.uniform(0.18, 0.3)), bool(rng.uniform() < 0.5)
    counts = [max(1, round((b - a) / float(rng.uniform(5.0, 6.5))) - 1) for a, b in zip(low, high, strict=True)]
    return tuple(
        (
            low[0] + (high[0] - low[0]) * (i + 1) / (counts[0] + 1),
            low[1] + (high[1] - low[1]) * (j + 1) / (counts[1] + 1),
            half,
            is_round,
        )
        for i in range(counts[0])
        for j in range(counts[1])
    )


def _lobby(rng: np.random.Generator) -> Plan:
    """A lobby with columns and reception, a glazed front, rooms behind and a corridor off it."""
    length, depth = float(rng.uniform(13, 18)), float(rng.uniform(9, 12.5))
    outline = shaped(rectangle(0, 0, length, depth), rng, (0, 1), 1.2)
    w = INNER_WALL_M
    rooms = [room_of("lobby", outline, rng, random_height(rng, 3.3, 4.2))]
    rooms += row_of_rooms(
        0.0, length, depth + w, float(rng.uniform(3.6, 5.0)), True, ("office", "meeting", "storage", "kitchen"), rng
    )
    behind = len(rooms)
    wide, y0 = float(rng.uniform(2.2, 3.2)), float(depth * rng.uniform(0.45, 0.6))
    rooms.append(
        room_of("corridor", rectangle(length + w, y0, length + w + float(rng.uniform(6, 9)), y0 + wide), rng, 2.7)
    )
    openings = doors_to(rooms, 0, range(1, behind), rng, 0.4)
    openings.append(connect(rooms, behind, 0, "passage", wide - 0.35, rng, 2.45))
    openings += _front(rooms[0], rng)
    return _finished("lobby", rooms, openings, rng, columns=_columns((0, 0), (length, depth), rng))


def _front(room: Room, rng: np.random.Generator) -> list[Opening | None]:
    """Large panes in the wall on the line y = 0."""
    for start, end in room.edges():
        if abs(start[1]) + abs(end[1]) < 1e-9:
            length = float(np.hypot(*(end - start)))
            count = max(1, int(length // 3.2))
            ends = np.linspace(0.4, length - 0.4, count + 1)
            along = (end - start) / length
            top = room.height - float(rng.uniform(0.3, 0.8))
            return [
                Opening(start + along * (a + 0.15), start + along * (b - 0.15), 0.05, top, "window")
                for a, b in pairwise(ends)
            ]
    return []


def _open_plan(rng: np.random.Generator) -> Plan:
    """An open office floor with columns, meeting rooms behind glass on one side and a kitchen corner."""
    length, depth = float(rng.uniform(15, 22)), float(rng.uniform(9.5, 13))
    outline = shaped(rectangle(0, 0, length, depth), rng, (0, 1), 1.1)
    w = INNER_WALL_M
    rooms = [room_of("open_plan", outline, rng, random_height(rng, 2.7, 3.4))]
    rooms += row_of_rooms(
        0.0,
        length,
        depth + w,
        float(rng.uniform(3.2, 4.4)),
        True,
        ("meeting", "meeting", "kitchen", "office", "storage"),
        rng,
    )
    side = len(rooms)
    wide, y0 = float(rng.uniform(3.0, 4.5)), float(depth * rng.uniform(0.3, 0.55))
    rooms.append(
        room_of(
            str(rng.choice(["lounge", "kitchen"])), rectangle(length + w, y0, length + w + wide, y0 + 4.0), rng, 2.7
        )
    )
    openings = doors_to(rooms, 0, range(1, side), rng, 0.75)
    openings.append(connect(rooms, side, 0, "passage", 1.8, rng, 2.4))
    return _finished("open_plan", rooms, openings, rng, columns=_columns((0, 0), (length, depth), rng))


def _suite(use: str, rng: np.random.Generator) -> Plan:
    """A small room of one use, with a corridor before it and another room beside it."""
    sizes = {
        "office": (3.6, 6.2, 3.6, 5.4),
        "meeting": (4.4, 7.0, 3.8, 5.6),
        "classroom": (7.0, 9.5, 5.8, 7.2),
        "kitchen": (3.8, 6.5, 3.4, 5.0),
        "lounge": (4.8, 7.5, 4.2, 6.0),
        "storage": (3.6, 6.0, 3.4, 5.0),
    }
    low_x, high_x, low_y, high_y = sizes[use]
    width, depth = float(rng.uniform(low_x, high_x)), float(rng.uniform(low_y, high_y))
    w = INNER_WALL_M
    main = shaped(rectangle(0, 0, width, depth), rng, (2, 3), 1.25)
    rooms = [room_of(use, main, rng, random_height(rng))]
    beside = float(rng.uniform(2.6, 4.2))
    other = rectangle(width + w, 0, width + w + beside, float(depth * rng.uniform(0.75, 1.0)))
    rooms.append(room_of(str(rng.choice(_SIDE_USES)), shaped(other, rng, (2,), 0.6), rng, random_height(rng, 2.5, 2.9)))
    wide = float(rng.uniform(1.5, 2.3))
    rooms.append(
        room_of(
            "corridor",
            rectangle(-float(rng.uniform(0.5, 2.0)), -w - wide, width + w + beside, -w),
            rng,
            random_height(rng, 2.4, 2.7),
        )
    )
    openings: list[Opening | None] = doors_to(rooms, 2, (0, 1), rng, 0.35)
    if rng.uniform() < 0.5:
        openings.append(connect(rooms, 0, 1, str(rng.choice(["door", "passage"])), 0.95, rng))
    return _finished(use, rooms, openings, rng)
