"""How corridors, hallways, lobbies and open-plan floors are furnished."""

from __future__ import annotations

import numpy as np

from pcdbench.datasets.synthetic.groups import (
    TABLE_THINGS,
    any_of,
    put_island,
    put_plants,
    put_seating,
    put_seating_somewhere,
    put_stores,
    put_sundries,
    put_table,
    put_table_somewhere,
    spin,
)
from pcdbench.datasets.synthetic.placement import Placement
from pcdbench.datasets.synthetic.plan import Room


def furnish_corridor(placement: Placement, room: Room) -> None:
    """Things along the walls: benches, cupboards, plants."""
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


def furnish_hallway(placement: Placement, room: Room) -> None:
    """A corridor's things, lockers, and groups of seats and tables where it is wide."""
    furnish_corridor(placement, room)
    rng = placement.rng
    for _ in range(int(rng.integers(5, 10))):
        placement.at_wall(room, any_of(placement, ["lockers", "lockers", "bench", "bookcase"]), off_m=0.02)
    for _ in range(int(rng.integers(1, 4))):
        put_seating_somewhere(placement, room, 5)
    for _ in range(int(rng.integers(1, 3))):
        put_table_somewhere(placement, room, "round_table", TABLE_THINGS, "chair")
    put_plants(placement, room, 3)


def furnish_lobby(placement: Placement, room: Room) -> None:
    """A reception, groups of seats, round tables, plants."""
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


def furnish_open_plan(placement: Placement, room: Room) -> None:
    """Desk islands on a grid, a few groups of seats and tables between them, stores and screens."""
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
