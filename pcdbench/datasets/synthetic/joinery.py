"""What is in the openings of walls: doors, windows, glazed partitions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.plan import INNER_WALL_M, Opening
from pcdbench.datasets.synthetic.primitives import box, panel_with_openings, tube


def filling(opening: Opening, rng: np.random.Generator) -> list[Mesh]:
    """What is in an opening: a frame, a leaf or panes; in its own frame, x along it, y into the room."""
    width, tall = opening.width, opening.z1 - opening.z0
    along = (opening.end - opening.start) / width
    yaw = float(np.arctan2(along[1], along[0]))
    tint = int(rng.integers(0, 2**31))
    parts: list[Mesh] = []
    if opening.kind in ("door", "passage"):
        parts.append(
            box(
                (width, INNER_WALL_M + 0.004, 0.1), (width / 2, -INNER_WALL_M / 2, -0.05 + 0.002), "brushed_steel", tint
            )
        )
    if opening.kind == "door":
        parts += _door(opening, width, tall, tint, rng)
    elif opening.kind == "window":
        parts += _window(width, tall, tint, rng)
    elif opening.kind == "glazing":
        parts += _glazing(width, tall, tint)
    return [part.moved((*opening.start, opening.z0), yaw) for part in parts]


def _door(opening: Opening, width: float, tall: float, tint: int, rng: np.random.Generator) -> list[Mesh]:
    deep = INNER_WALL_M + 0.03
    middle = -INNER_WALL_M / 2
    frame = str(rng.choice(["door_paint", "painted_metal", "door_wood"]))
    parts = [
        box((0.05, deep, tall), (0.025, middle, tall / 2), frame, tint),
        box((0.05, deep, tall), (width - 0.025, middle, tall / 2), frame, tint),
        box((width - 0.1, deep, 0.05), (width / 2, middle, tall - 0.025), frame, tint),
    ]
    leaf_width, leaf_tall = width - 0.11, tall - 0.065
    material = str(rng.choice(["door_wood", "door_paint"]))
    holes = []
    if rng.uniform() < 0.3:
        holes = [(leaf_width * 0.3, leaf_width * 0.7, leaf_tall * 0.5, leaf_tall * 0.88)]
    leaf = panel_with_openings(leaf_width, leaf_tall, 0.04, holes, material, tint + 1)
    pieces = [leaf]
    if holes:
        x0, x1, z0, z1 = holes[0]
        pieces.append(box((x1 - x0, 0.006, z1 - z0), ((x0 + x1) / 2, 0.0, (z0 + z1) / 2), "glass"))
    for side in (-1.0, 1.0):
        knob = leaf_width - 0.07
        path = [(knob, side * 0.02, 1.02), (knob, side * 0.07, 1.02), (knob - 0.12, side * 0.07, 1.02)]
        pieces.append(tube(path, 0.01, "brushed_steel", tint, 6))
    leaf = Mesh.merge(pieces).moved((0.0, 0.0, 0.012))
    turned = leaf.moved((0.055, 0.0, 0.0), np.radians(opening.swing_deg))
    return [*parts, turned]


def _window(width: float, tall: float, tint: int, rng: np.random.Generator) -> list[Mesh]:
    y = -0.2
    frame = str(rng.choice(["white_plastic", "painted_metal", "door_wood"]))
    bar = 0.06
    parts = [box((width, bar, bar), (width / 2, y, z), frame, tint) for z in (bar / 2, tall - bar / 2)]
    posts = [bar / 2, width - bar / 2, *([width / 2] if width > 1.2 else [])]
    parts += [box((bar, bar, tall - 2 * bar), (x, y, tall / 2), frame, tint) for x in posts]
    if tall > 1.4 and rng.uniform() < 0.5:
        parts.append(box((width - 2 * bar, bar, bar), (width / 2, y, tall * 0.7), frame, tint))
    parts.append(box((width - bar, 0.012, tall - bar), (width / 2, y, tall / 2), "glass", tint))
    parts.append(box((width + 0.06, 0.24, 0.03), (width / 2, -0.08, 0.015), "white_plastic", tint))
    drawn = float(rng.choice([0.0, 0.0, 0.25, 0.5, 1.0]))
    if drawn:
        length = tall * drawn
        parts.append(box((width - 0.04, 0.02, length), (width / 2, -0.1, tall - length / 2), "blinds", tint))
        parts.append(box((width - 0.04, 0.06, 0.06), (width / 2, -0.1, tall - 0.03), "painted_metal", tint))
    return parts


def _glazing(width: float, tall: float, tint: int) -> list[Mesh]:
    count = max(1, round(width / 1.15))
    posts = np.linspace(0.025, width - 0.025, count + 1)
    y = -INNER_WALL_M / 2
    parts = [box((0.05, 0.07, tall), (x, y, tall / 2), "painted_metal", tint) for x in posts]
    parts += [box((width, 0.07, 0.05), (width / 2, y, z), "painted_metal", tint) for z in (0.025, tall - 0.025)]
    parts.append(box((width - 0.05, 0.012, tall - 0.05), (width / 2, y, tall / 2), "glass", tint))
    parts += [
        box((float(b - a) - 0.05, 0.014, 0.22), (float(a + b) / 2, y, 1.35), "white_plastic", tint)
        for a, b in pairwise(posts)
    ]
    return parts
