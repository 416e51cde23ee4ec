"""Machines of offices and corridors."""

from __future__ import annotations

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import Built, Rng, built, chance, pick, tint
from pcdbench.datasets.synthetic.primitives import (
    box,
    boxes,
    cylinder,
    lathe,
    panel_with_openings,
    rounded_box,
    tube,
)


def vending_machine(rng: Rng) -> Built:
    """A vending machine: lit goods in a window, a panel with keys, a slot below."""
    width, depth, height = rng.uniform(0.85, 1.05), rng.uniform(0.75, 0.88), rng.uniform(1.8, 1.95)
    color, y = tint(rng), depth / 2
    keys = [[width * 0.36 + dx, y + 0.008, 1.05 + 0.04 * k] for k in range(4) for dx in (-0.035, 0, 0.035)]
    parts = [
        rounded_box((width, depth, height - 0.06), (0, 0, 0.06 + (height - 0.06) / 2), 0.03, "colored_metal", color),
        box((width - 0.06, depth - 0.08, 0.08), (0, 0, 0.04), "black_metal"),
        box((width * 0.66, 0.012, height * 0.62), (-width * 0.12, y, height * 0.58), "goods", color),
        box((width * 0.5, 0.014, 0.18), (-width * 0.12, y, 0.36), "black_plastic"),
        box((0.16, 0.012, 0.5), (width * 0.36, y, 1.2), "black_plastic"),
        box((0.12, 0.014, 0.09), (width * 0.36, y + 0.003, 1.37), "screen", color),
        boxes((0.026, 0.01, 0.026), keys, "white_plastic"),
        box((width * 0.8, 0.012, 0.14), (0, y, height - 0.11), "sign_blue", color),
    ]
    return built(parts)


def water_cooler(rng: Rng) -> Built:
    """A water cooler: a slim column, a niche with taps, a large bottle upside down."""
    width, height, color = rng.uniform(0.29, 0.34), rng.uniform(0.95, 1.05), tint(rng)
    material = pick(rng, ("white_plastic", "gray_plastic", "white_plastic"))
    bottle = [
        (0, 0),
        (0.045, 0),
        (0.05, 0.05),
        (0.13, 0.12),
        (0.135, 0.2),
        (0.128, 0.23),
        (0.135, 0.26),
        (0.135, 0.38),
        (0.12, 0.43),
        (0, 0.435),
    ]
    low = height * 0.62
    parts = [
        rounded_box((width, width, low), (0, 0, low / 2), 0.02, material, color),
        box((width * 0.92, width * 0.55, height - low), (0, -width * 0.2, (height + low) / 2), "gray_plastic", color),
        rounded_box((width, width, height * 0.14), (0, 0, height * 0.93), 0.02, material, color),
        box((width * 0.7, width * 0.3, 0.015), (0, width * 0.25, low + 0.008), "black_plastic"),
        lathe(bottle, "clear_plastic", 7, (0, 0, height)),
    ]
    for s, tap in ((-1, "plastic"), (1, "red_gloss")):
        parts.append(boxes((0.025, 0.07, 0.03), [[s * 0.06, width * 0.12, height * 0.8]], tap, 1))
        parts.append(cylinder(0.009, 0.05, (s * 0.06, width * 0.2, height * 0.75), "white_plastic", segments=8))
    return built(parts)


def printer(rng: Rng) -> Built:
    """An office copier: paper drawers, an output slot, a scanner lid, a tilted panel."""
    width, depth, height = rng.uniform(0.56, 0.68), rng.uniform(0.55, 0.66), rng.uniform(0.95, 1.15)
    color, y = tint(rng), depth / 2
    body = pick(rng, ("white_plastic", "gray_plastic"))
    drawers = int(rng.integers(2, 5))
    low = height * 0.55
    face = (low - 0.08) / drawers
    levels = [[0, y, 0.07 + face * (k + 0.5)] for k in range(drawers)]
    panel = box((0.28, 0.14, 0.02), (0, 0, 0), "screen", color).rotated("x", -0.5)
    parts = [
        box((width, depth, low - 0.05), (0, 0, 0.05 + (low - 0.05) / 2), body, color),
        boxes((width - 0.02, 0.025, face - 0.012), levels, "gray_plastic", color),
        boxes((0.16, 0.03, 0.022), np.add(levels, (0, 0.005, face * 0.25)), "black_plastic"),
        boxes(
            (0.06, 0.06, 0.05),
            [[a * width * 0.42, b * depth * 0.42, 0.025] for a in (-1, 1) for b in (-1, 1)],
            "rubber",
        ),
        box((width * 0.3, depth * 0.9, height * 0.18), (width * 0.35, 0, low + height * 0.09), body, color),
        box(
            (width * 0.7, depth * 0.25, height * 0.18), (-width * 0.15, -depth * 0.32, low + height * 0.09), body, color
        ),
        rounded_box((width, depth, height * 0.16), (0, 0, low + height * 0.26), 0.015, body, color),
        rounded_box(
            (width * 0.96, depth * 0.85, height * 0.11), (0, -0.02, height * 0.945), 0.02, "gray_plastic", color
        ),
        box((0.3, 0.21, 0.02), (-width * 0.12, 0.02, low + 0.012), "paper", color),
        panel.moved((width * 0.22, y + 0.06, low + height * 0.3)),
    ]
    return built(parts)


def desktop_printer(rng: Rng) -> Built:
    """A small printer with paper in its trays."""
    width, depth, height = rng.uniform(0.38, 0.46), rng.uniform(0.34, 0.42), rng.uniform(0.18, 0.28)
    body, color = pick(rng, ("white_plastic", "black_plastic", "gray_plastic")), tint(rng)
    parts = [
        rounded_box((width, depth, height), (0, 0, height / 2), 0.025, body, color),
        box((width * 0.6, 0.16, 0.008), (0, depth / 2 + 0.06, 0.05), "paper", color),
        box((width * 0.65, 0.02, 0.05), (0, depth / 2, 0.07), "black_plastic"),
        box((0.23, 0.01, 0.22), (0, -depth * 0.35, height + 0.08), "pages", color).deformed(
            lambda v: v - np.column_stack([0 * v[:, 0], 0.3 * (v[:, 2] - height), 0 * v[:, 0]])
        ),
        box((0.12, 0.006, 0.05), (width * 0.28, depth / 2 + 0.001, height * 0.75), "screen", color),
    ]
    return built(parts)


def server_rack(rng: Rng) -> Built:
    """A rack of servers behind an open frame: dark units with lights, patch cables."""
    width, depth, height = 0.6, rng.uniform(0.8, 1.0), rng.uniform(1.6, 2.05)
    frame = panel_with_openings(width, height, 0.03, [(0.06, width - 0.06, 0.12, height - 0.08)], "black_metal")
    parts = [
        frame.moved((-width / 2, depth / 2 - 0.015, 0)),
        boxes(
            (0.02, depth - 0.03, height), [[s * (width / 2 - 0.01), -0.015, height / 2] for s in (-1, 1)], "black_metal"
        ),
        boxes((width, depth - 0.03, 0.03), [[0, -0.015, 0.015], [0, -0.015, height - 0.015]], "black_metal"),
        box((width, 0.02, height), (0, -depth / 2 + 0.01, height / 2), "black_metal"),
    ]
    z = 0.14
    while z < height - 0.2:
        units = pick(rng, (0.044, 0.044, 0.089, 0.133))
        if chance(rng, 0.8):
            face = pick(rng, ("gray_plastic", "grille", "brushed_steel", "black_plastic", "screen"))
            parts.append(box((0.46, depth * 0.7, units - 0.005), (0, 0.04, z + units / 2), face, tint(rng)))
        z += units
    for _ in range(6):
        x0, x1 = rng.uniform(-0.2, 0.2, 2)
        z0, z1 = rng.uniform(0.4, height - 0.4, 2)
        y = depth / 2 - 0.06
        path = [
            [x0, y - 0.05, z0],
            [x0, y, z0],
            [(x0 + x1) / 2 + 0.1, y + 0.02, (z0 + z1) / 2],
            [x1, y, z1],
            [x1, y - 0.05, z1],
        ]
        parts.append(tube(path, 0.006, "plastic", tint(rng), segments=5))
    return built(parts)
