"""What hangs on ceilings beside what the building brings: alarms, sprinklers, air, signs."""

from __future__ import annotations

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import Built, Rng, built, chance, pick, tint
from pcdbench.datasets.synthetic.primitives import (
    box,
    boxes,
    cylinder,
    lathe,
    rounded_box,
    torus,
    tube,
)


def sprinkler(rng: Rng) -> Built:
    """A sprinkler head."""
    drop = rng.uniform(0.02, 0.08)
    parts = [
        cylinder(0.03, 0.006, (0, 0, -0.006), "chrome", segments=14),
        cylinder(0.009, drop, (0, 0, -drop), "chrome", segments=8),
    ]
    arms = [
        tube([[0, 0, -drop], [s * 0.014, 0, -drop - 0.015], [0, 0, -drop - 0.03]], 0.003, "chrome", 0, 5)
        for s in (-1, 1)
    ]
    return built([*parts, *arms, cylinder(0.018, 0.003, (0, 0, -drop - 0.034), "chrome", segments=12)])


def smoke_detector(rng: Rng) -> Built:
    """A smoke detector."""
    radius = rng.uniform(0.045, 0.06)
    return built(
        [
            lathe(
                [(0, -0.05), (radius * 0.6, -0.048), (radius * 0.65, -0.03), (radius, -0.025), (radius, 0)],
                "white_plastic",
                tint(rng),
            )
        ]
    )


def cassette_unit(rng: Rng) -> Built:
    """An air-conditioning cassette: a frame with four slots around a grille."""
    side, color = rng.uniform(0.6, 0.85), tint(rng)
    slots = [[0, s * (side / 2 - 0.09), -0.036] for s in (-1, 1)]
    across = [[s * (side / 2 - 0.09), 0, -0.036] for s in (-1, 1)]
    parts = [
        rounded_box((side, side, 0.05), (0, 0, -0.012), 0.015, "white_plastic", color),
        boxes((side * 0.6, 0.05, 0.008), slots, "black_plastic"),
        boxes((0.05, side * 0.6, 0.008), across, "black_plastic"),
        box((side * 0.5, side * 0.5, 0.012), (0, 0, -0.038), "grille", color),
    ]
    return built([part.moved((0, 0, -0.013)) for part in parts])


def ceiling_grille(rng: Rng) -> Built:
    """A ventilation outlet: louvres in a frame, or a round diffuser of rings."""
    if chance(rng, 0.4):
        rings = [torus(r, 0.012, (0, 0, -0.015 - (0.2 - r) * 0.15), "white_plastic") for r in (0.06, 0.11, 0.16, 0.2)]
        return built([*rings, cylinder(0.2, 0.004, (0, 0, -0.006), "gray_plastic", segments=20)])
    width, depth = rng.uniform(0.3, 0.6), rng.uniform(0.2, 0.6)
    y = np.arange(-depth / 2 + 0.04, depth / 2 - 0.03, 0.03)
    louvre = box((width - 0.05, 0.025, 0.004), (0, 0, 0), "white_plastic").rotated("x", 1.0)
    parts = [louvre.moved((0, at, -0.016)) for at in y]
    parts += [
        boxes((width, 0.025, 0.022), [[0, s * (depth / 2 - 0.0125), -0.011] for s in (-1, 1)], "white_plastic"),
        boxes((0.025, depth, 0.022), [[s * (width / 2 - 0.0125), 0, -0.011] for s in (-1, 1)], "white_plastic"),
        box((width - 0.03, depth - 0.03, 0.002), (0, 0, -0.002), "black_plastic"),
    ]
    return built(parts)


def hanging_sign(rng: Rng) -> Built:
    """An exit or way-finding sign hung from the ceiling."""
    width, drop = rng.uniform(0.35, 0.8), rng.uniform(0.15, 0.4)
    parts = [
        box((width, 0.04, 0.2), (0, 0, -drop - 0.1), pick(rng, ("sign_green", "sign_green", "sign_blue")), tint(rng))
    ]
    parts.append(boxes((0.012, 0.012, drop), [[s * width * 0.35, 0, -drop / 2] for s in (-1, 1)], "brushed_steel"))
    return built(parts)
