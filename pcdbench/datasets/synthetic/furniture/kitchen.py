"""Kitchens and what stands in them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import Built, Rng, Top, built, chance, pick, round_rectangle, tint
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.primitives import (
    box,
    boxes,
    cylinder,
    frustum,
    prism,
    rounded_box,
    tube,
)


def _sink(x: float, width: float, z: float) -> list[Mesh]:
    """A steel basin below z with its tap behind."""
    depth, deep = 0.36, 0.18
    ring = round_rectangle(width + 0.03, depth + 0.03, 0.05)
    hole = round_rectangle(width, depth, 0.045)
    middle = np.array([x, 0.03])
    spout = [
        [x, -0.2, z],
        [x, -0.2, z + 0.2],
        [x, -0.18, z + 0.27],
        [x, -0.12, z + 0.3],
        [x, -0.06, z + 0.27],
        [x, -0.05, z + 0.22],
    ]
    return [
        prism(ring + middle, z - 0.002, z + 0.004, "brushed_steel", holes=[hole + middle]),
        prism(ring + middle, z - deep, z - 0.001, "brushed_steel", holes=[hole + middle]),
        box((width + 0.02, depth + 0.02, 0.006), (x, 0.03, z - deep), "brushed_steel"),
        cylinder(0.03, 0.006, (x, 0.03, z - deep + 0.003), "black_metal", segments=12),
        tube(spout, 0.013, "chrome"),
        cylinder(0.024, 0.05, (x, -0.2, z), "chrome", segments=12),
        tube([[x, -0.2, z + 0.06], [x + 0.09, -0.18, z + 0.1]], 0.008, "chrome", segments=6),
    ]


def kitchen_counter(rng: Rng) -> Built:
    """A kitchen run: base cabinets with doors and drawers, a top with sink and tap, perhaps a hob, cabinets above."""
    units = int(rng.integers(3, 6))
    width, depth, height = units * 0.6, 0.6, rng.uniform(0.88, 0.93)
    face, color, top = pick(rng, ("board", "wood", "board")), tint(rng), pick(rng, ("stone_counter", "wood", "marble"))
    top_tint, thick = tint(rng), 0.04
    sink_x = -width / 2 + 0.6 * (int(rng.integers(units - 1)) + 0.5)
    hole = np.add(round_rectangle(0.46, 0.36, 0.045), (sink_x, 0.03))
    bound = [
        (-width / 2, -depth / 2),
        (width / 2, -depth / 2),
        (width / 2, depth / 2 + 0.02),
        (-width / 2, depth / 2 + 0.02),
    ]
    sides = np.linspace(-width / 2 + 0.009, width / 2 - 0.009, units + 1)
    parts = [
        prism(bound, height - thick, height, top, top_tint, holes=[hole]),
        box((width, 0.02, 0.1), (0, -depth / 2 + 0.01, height + 0.05), top, top_tint),
        boxes(
            (0.018, depth - 0.04, height - thick - 0.1),
            [[x, 0, 0.1 + (height - thick - 0.1) / 2] for x in sides],
            face,
            color,
        ),
        box((width, depth - 0.1, 0.1), (0, -0.03, 0.05), "black_metal"),
        box((width, 0.01, height - 0.1), (0, -depth / 2 + 0.02, height / 2), face, color),
        *_sink(sink_x, 0.46, height),
    ]
    for k in range(units):
        x = -width / 2 + 0.6 * (k + 0.5)
        low, high = 0.11, height - thick - 0.01
        pieces = int(rng.integers(1, 4))
        edges = np.linspace(low, high, pieces + 1)
        for bottom, upper in pairwise(edges):
            parts.append(
                box((0.59, 0.02, upper - bottom - 0.01), (x, depth / 2 - 0.01, (bottom + upper) / 2), face, color)
            )
            parts.append(box((0.2, 0.025, 0.014), (x, depth / 2 + 0.02, upper - 0.05), "brushed_steel"))
    if units > 3:
        hob = 0.6 * (units / 2 - 0.5) if sink_x < width / 2 - 0.6 else -width / 2 + 0.3
        parts.append(box((0.54, 0.48, 0.008), (hob, 0.03, height + 0.004), "black_gloss"))
        for a in (-0.13, 0.13):
            for b in (-0.1, 0.14):
                parts.append(cylinder(0.08, 0.003, (hob + a, 0.03 + b, height + 0.008), "gray_plastic", 1, 16))
    if chance(rng, 0.7):
        bottom, tall = rng.uniform(1.4, 1.5), rng.uniform(0.6, 0.75)
        parts.append(box((width, 0.34, tall), (0, -depth / 2 + 0.17, bottom + tall / 2), face, color))
        leaf = [[-width / 2 + 0.6 * (k + 0.5), -depth / 2 + 0.35, bottom + tall / 2] for k in range(units)]
        parts.append(boxes((0.59, 0.02, tall - 0.01), leaf, face, color))
        parts.append(boxes((0.014, 0.025, 0.12), np.add(leaf, (0.25, 0.02, -tall / 2 + 0.12)), "brushed_steel"))
    free = 1 if sink_x < 0 else -1
    return built(parts, Top((free * width * 0.25, 0.05), (width * 0.3, 0.4), height))


def fridge(rng: Rng) -> Built:
    """A refrigerator: freezer above or below, bar handles."""
    width, depth, height = rng.uniform(0.55, 0.75), rng.uniform(0.58, 0.68), rng.uniform(1.5, 1.9)
    material, color = pick(rng, ("white_plastic", "brushed_steel", "black_metal", "colored_metal")), tint(rng)
    split = height * pick(rng, (0.33, 0.68))
    front = depth / 2
    parts = [
        box((width, depth - 0.06, height - 0.03), (0, -0.03, 0.03 + (height - 0.03) / 2), material, color),
        box((width - 0.04, depth - 0.1, 0.03), (0, -0.03, 0.015), "black_metal"),
        rounded_box((width, 0.07, split - 0.05), (0, front, 0.04 + (split - 0.05) / 2), 0.02, material, color),
        rounded_box(
            (width, 0.07, height - split - 0.01), (0, front, split + (height - split) / 2), 0.02, material, color
        ),
    ]
    for low, high in ((max(0.3, split - 0.55), split - 0.06), (split + 0.06, min(height - 0.1, split + 0.5))):
        x = width / 2 - 0.07
        path = [
            [x, front + 0.03, low],
            [x, front + 0.075, low + 0.02],
            [x, front + 0.075, high - 0.02],
            [x, front + 0.03, high],
        ]
        parts.append(tube(path, 0.011, "chrome", segments=6))
    if chance(rng, 0.4):
        parts.append(
            boxes(
                (0.1, 0.003, 0.13),
                [[-0.1, front + 0.036, height - 0.3], [0.08, front + 0.036, height - 0.42]],
                "artwork",
                tint(rng),
            )
        )
    return built(parts)


def dishwasher(rng: Rng) -> Built:
    """A dish washer or an oven: a control strip, a handle, a door."""
    oven = chance(rng, 0.4)
    material, color, height = (
        pick(rng, ("white_plastic", "brushed_steel", "black_metal")),
        tint(rng),
        rng.uniform(0.82, 0.87),
    )
    parts = [
        box((0.595, 0.57, height - 0.08), (0, 0, 0.08 + (height - 0.08) / 2), material, color),
        box((0.56, 0.5, 0.08), (0, -0.02, 0.04), "black_metal"),
        box((0.585, 0.025, height - 0.24), (0, 0.295, 0.1 + (height - 0.24) / 2), material, color),
        box((0.585, 0.02, 0.11), (0, 0.295, height - 0.065), "black_plastic"),
        tube([[-0.24, 0.33, height - 0.17], [0.24, 0.33, height - 0.17]], 0.011, "chrome", segments=6),
        boxes((0.02, 0.05, 0.02), [[s * 0.22, 0.31, height - 0.17] for s in (-1, 1)], "chrome"),
    ]
    if oven:
        parts.append(box((0.44, 0.004, 0.3), (0, 0.309, 0.4), "black_gloss"))
        knobs = [cylinder(0.02, 0.03, (0, 0, 0), "brushed_steel", 1, 12).rotated("x", -np.pi / 2) for _ in range(4)]
        parts += [knob.moved((-0.18 + 0.12 * k, 0.3, height - 0.065)) for k, knob in enumerate(knobs)]
    else:
        parts.append(box((0.1, 0.004, 0.03), (0.15, 0.306, height - 0.065), "screen", color))
    return built(parts, Top((0.0, 0.0), (0.5, 0.45), height))


def microwave(rng: Rng) -> Built:
    """A microwave oven: a dark window, a row of buttons, a handle."""
    width, depth, height = rng.uniform(0.45, 0.53), rng.uniform(0.33, 0.4), rng.uniform(0.26, 0.31)
    material, color = pick(rng, ("white_plastic", "brushed_steel", "black_plastic")), tint(rng)
    y = depth / 2
    buttons = [[width / 2 - 0.055 + dx, y + 0.004, 0.06 + 0.035 * k] for k in range(4) for dx in (-0.025, 0, 0.025)]
    parts = [
        rounded_box((width, depth, height - 0.012), (0, 0, 0.012 + (height - 0.012) / 2), 0.012, material, color),
        boxes(
            (0.03, 0.03, 0.014), [[a * width * 0.4, b * depth * 0.4, 0.007] for a in (-1, 1) for b in (-1, 1)], "rubber"
        ),
        box((width * 0.66, 0.008, height * 0.72), (-width * 0.13, y, height / 2 + 0.005), "black_gloss"),
        boxes((0.018, 0.008, 0.02), buttons, "gray_plastic", color),
        box((0.08, 0.006, 0.035), (width / 2 - 0.055, y + 0.002, height - 0.06), "screen", color),
        tube([[width * 0.22, y + 0.03, 0.06], [width * 0.22, y + 0.03, height - 0.05]], 0.009, "chrome", segments=6),
    ]
    return built(parts, Top((0.0, 0.0), (width - 0.08, depth - 0.08), height))


def coffee_machine(rng: Rng) -> Built:
    """A coffee machine: a C-shaped body, spouts over a drip tray, a bean hopper or tank."""
    width, depth, height = rng.uniform(0.26, 0.36), rng.uniform(0.36, 0.45), rng.uniform(0.36, 0.55)
    material, color = pick(rng, ("black_plastic", "brushed_steel", "red_gloss", "gray_plastic")), tint(rng)
    parts = [
        rounded_box((width, depth * 0.55, height * 0.9), (0, -depth * 0.22, height * 0.45), 0.02, material, color),
        rounded_box((width, depth, height * 0.32), (0, 0, height * 0.75), 0.02, material, color),
        rounded_box((width, depth, 0.06), (0, 0, 0.03), 0.012, material, color),
        box((width * 0.8, depth * 0.36, 0.008), (0, depth * 0.27, 0.063), "grille", color),
        box((width * 0.5, 0.006, height * 0.14), (0, depth / 2, height * 0.77), "screen", color),
        frustum(width * 0.3, width * 0.38, height * 0.14, (0, -depth * 0.15, height * 0.9), "clear_plastic", color),
    ]
    for s in (-1, 1):
        parts.append(frustum(0.01, 0.018, 0.07, (s * 0.025, depth * 0.27, height * 0.53), "chrome", segments=10))
    if chance(rng, 0.5):
        parts.append(frustum(0.028, 0.036, 0.08, (0, depth * 0.27, 0.067), "ceramic", tint(rng), 14))
    return built(parts)
