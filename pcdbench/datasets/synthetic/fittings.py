"""What rooms of every use get: at windows, on walls, on the ceiling and left on the floor."""

from __future__ import annotations

import math

import numpy as np

from pcdbench.datasets.synthetic.groups import any_of, long_yaw
from pcdbench.datasets.synthetic.placement import Placement
from pcdbench.datasets.synthetic.plan import Floats, Room

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


def put_on_walls(placement: Placement, room: Room) -> None:
    """Pictures, boards, shelves and the like, the more the longer the walls."""
    perimeter = float(np.hypot(*(np.roll(room.outline, -1, axis=0) - room.outline).T).sum())
    for _ in range(int(placement.rng.integers(4, 6 + int(perimeter / 3.5)))):
        placement.at_wall(room, any_of(placement, WALL_THINGS), off_m=0.0, tries=6)


def put_at_windows(placement: Placement, room: Room) -> None:
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
    placement.put(room, name, placement.build(name), float(x), float(y), math.atan2(along[1], along[0]))


def put_on_ceiling(placement: Placement, room: Room) -> None:
    """Detectors, grilles, signs and the like."""
    rng = placement.rng
    low, high = room.outline.min(axis=0), room.outline.max(axis=0)
    for _ in range(int(rng.integers(0, 3 + int(np.prod(high - low) / 10)))):
        name = any_of(placement, CEILING_THINGS)
        x, y = rng.uniform(low, high)
        placement.put(room, name, placement.build(name), float(x), float(y), long_yaw(room), room.height - 0.001, 0.02)


def put_clutter(placement: Placement, room: Room, count: int) -> None:
    """Things that someone left on the floor, most of them at a wall."""
    for _ in range(count):
        name = any_of(placement, CLUTTER)
        if placement.rng.uniform() < 0.7:
            placement.at_wall(room, name, jitter_rad=0.3, off_m=float(placement.rng.uniform(0.02, 0.15)))
        else:
            placement.somewhere(room, name, 5, 0.1)
