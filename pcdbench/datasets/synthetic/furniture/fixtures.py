"""What is fixed to walls, but for boards and screens."""

from __future__ import annotations

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import Built, Rng, built, chance, pick, tint
from pcdbench.datasets.synthetic.mesh import Floats, Mesh
from pcdbench.datasets.synthetic.primitives import (
    box,
    boxes,
    cylinder,
    ellipsoid,
    lathe,
    profile_prism,
    rounded_box,
    sphere,
    surface,
    tube,
)


def radiator(rng: Rng) -> Built:
    """A column radiator under a window, with its valve and pipes."""
    width, height = rng.uniform(0.6, 1.4), rng.uniform(0.45, 0.65)
    color, columns = tint(rng), max(6, int(width / 0.06))
    x = np.linspace(-width / 2 + 0.025, width / 2 - 0.025, columns)
    column = rounded_box((0.038, 0.085, height), (0, 0.085, 0.12 + height / 2), 0.018, "radiator", color, 1)
    parts = [column.moved((at, 0, 0)) for at in x]
    parts += [tube([[x[0], 0.085, z], [x[-1], 0.085, z]], 0.02, "radiator", color, 6) for z in (0.17, 0.07 + height)]
    brackets = [[s * width * 0.3, 0.035, z] for s in (-1, 1) for z in (0.2, 0.04 + height)]
    parts.append(boxes((0.025, 0.07, 0.03), brackets, "painted_metal", color))
    valve_x = width / 2 + 0.05
    pipe = [[x[-1], 0.085, 0.17], [valve_x, 0.085, 0.17], [valve_x, 0.085, 0.0]]
    parts += [
        tube(pipe, 0.011, "radiator", color, 6),
        cylinder(0.022, 0.07, (valve_x, 0.085, 0.18), "white_plastic", segments=10),
    ]
    return built(parts)


def fire_extinguisher(rng: Rng) -> Built:
    """A fire extinguisher on its bracket, with hose and gauge."""
    radius, height, low = rng.uniform(0.065, 0.085), rng.uniform(0.4, 0.5), rng.uniform(0.5, 0.8)
    y = radius + 0.03
    body = [
        (0, 0),
        (radius * 0.92, 0),
        (radius, 0.02),
        (radius, height * 0.8),
        (radius * 0.7, height * 0.93),
        (0.025, height),
        (0.022, height + 0.03),
        (0, height + 0.03),
    ]
    hose = [
        [0.02, y, low + height + 0.03],
        [radius + 0.05, y + 0.02, low + height - 0.02],
        [radius + 0.03, y + 0.02, low + height * 0.5],
        [radius + 0.02, y + 0.02, low + 0.12],
    ]
    parts = [
        lathe(body, "red_gloss", 0, (0, y, low)),
        box((0.025, 0.11, 0.02), (0, y + 0.02, low + height + 0.045), "black_metal"),
        box((0.025, 0.1, 0.015), (0, y + 0.02, low + height + 0.08), "black_metal"),
        tube(hose, 0.011, "rubber", segments=6),
        box((0.04, 0.03, height * 0.7), (0, 0.015, low + height * 0.5), "black_metal"),
        box((radius * 1.1, 0.004, 0.14), (0, y + radius, low + height * 0.5), "paper", 3),
    ]
    if chance(rng, 0.6):
        parts.append(box((0.16, 0.008, 0.2), (0, 0.004, low + height + 0.4), "sign_blue", 2))
    return built(parts)


def clock(rng: Rng) -> Built:
    """A round wall clock."""
    radius, height = rng.uniform(0.13, 0.2), rng.uniform(1.9, 2.2)
    rim, color = pick(rng, ("black_plastic", "brushed_steel", "wood", "plastic")), tint(rng)
    case = lathe(
        [(0, 0), (radius, 0), (radius, 0.045), (radius - 0.015, 0.045), (radius - 0.015, 0.03), (0, 0.03)],
        rim,
        color,
        segments=28,
    )
    face = cylinder(radius - 0.015, 0.002, (0, 0, 0.03), "white_plastic", 0, 28)
    hands = [
        box((0.01, radius * r, 0.002), (0, radius * r / 2, 0.034), "black_plastic").rotated("z", rng.uniform(0, 6.28))
        for r in (0.5, 0.8)
    ]
    marks = [
        box((0.008, 0.03, 0.002), (0, radius - 0.035, 0.033), "black_plastic").rotated("z", k * np.pi / 6)
        for k in range(12)
    ]
    flat = Mesh.merge([case, face, *hands, *marks])
    return built([flat.rotated("x", -np.pi / 2).moved((0, 0, height))])


def curtain(rng: Rng) -> Built:
    """A pair of curtains in folds, hung from a rod."""
    width, top, bottom = rng.uniform(1.2, 2.4), rng.uniform(2.15, 2.4), pick(rng, (0.03, 0.03, 0.75))
    color = tint(rng)
    open_share = rng.uniform(0.2, 0.48)
    parts = [
        tube(
            [[-width / 2 - 0.1, 0.09, top], [width / 2 + 0.1, 0.09, top]],
            0.014,
            pick(rng, ("wood", "brushed_steel")),
            color,
        )
    ]
    for side in (-1, 1):
        span = width * open_share
        parts.append(drape(rng, span, top - 0.02 - bottom, color).moved((side * (width - span) / 2, 0.09, bottom)))
        parts.append(sphere(0.025, (side * (width / 2 + 0.1), 0.09, top), "brushed_steel", segments=8))
        parts.append(box((0.02, 0.1, 0.02), (side * (width / 2 + 0.03), 0.05, top), "brushed_steel"))
    return built(parts)


def drape(rng: Rng, width: float, height: float, color: int) -> Mesh:
    """A curtain in folds around the plane y = 0, from z = 0 to `height`, centred on x = 0."""
    folds = max(2.0, width / rng.uniform(0.11, 0.16))
    u = np.linspace(0.0, 1.0, int(folds * 6) + 1)
    v = np.linspace(0.0, 1.0, 5)
    phase = 2 * np.pi * folds * u + rng.uniform(0, 6.28)
    depth = (0.03 + 0.025 * (1 - v))[:, None] * np.sin(phase + 0.4 * np.sin(2 * np.pi * 1.7 * u))[None, :]
    x = width * (u[None, :] - 0.5) * (1 + 0.06 * (1 - v))[:, None]
    grid: Floats = np.stack([x, depth, np.broadcast_to(height * v[:, None], x.shape)], -1)
    return surface(grid[:, ::-1], "curtain", color)


def wall_air_conditioner(rng: Rng) -> Built:
    """An air-conditioning unit high on the wall."""
    width, height, low = rng.uniform(0.75, 1.0), rng.uniform(0.26, 0.31), rng.uniform(2.05, 2.2)
    profile = [(0, 0), (0.13, 0), (0.2, 0.09), (0.2, height - 0.06), (0.15, height), (0, height)]
    parts = [
        profile_prism(profile, -width / 2, width / 2, "white_plastic", tint(rng)),
        box((width * 0.85, 0.07, 0.008), (0, 0.165, 0.04), "gray_plastic"),
        box((0.08, 0.004, 0.02), (width * 0.35, 0.2, height * 0.45), "screen", 1),
    ]
    pipe = [[width / 2 - 0.01, 0.06, 0.1], [width / 2 + 0.06, 0.06, 0.08], [width / 2 + 0.06, 0.05, -0.3]]
    return built([part.moved((0, 0, low)) for part in [*parts, tube(pipe, 0.02, "white_plastic", 2)]])


def wall_grille(rng: Rng) -> Built:
    """A ventilation grille in the wall."""
    width, height, z = rng.uniform(0.3, 0.7), rng.uniform(0.15, 0.4), pick(rng, (0.35, 2.2))
    levels = np.arange(-height / 2 + 0.03, height / 2 - 0.02, 0.03)
    louvre = box((width - 0.04, 0.004, 0.026), (0, 0, 0), "painted_metal", 1).rotated("x", -0.6)
    parts = [louvre.moved((0, 0.014, z + at)) for at in levels]
    parts += [
        boxes((width, 0.022, 0.024), [[0, 0.011, z + s * height / 2] for s in (-1, 1)], "painted_metal", 1),
        boxes((0.024, 0.022, height), [[s * width / 2, 0.011, z] for s in (-1, 1)], "painted_metal", 1),
        box((width - 0.02, 0.003, height - 0.02), (0, 0.002, z), "black_plastic"),
    ]
    return built(parts)


def wall_lamp(rng: Rng) -> Built:
    """A lamp on the wall: half a bowl, or a globe on an arm."""
    z, color = rng.uniform(1.7, 2.0), tint(rng)
    if chance(rng, 0.5):
        return built(
            [
                ellipsoid((0.14, 0.09, 0.1), (0, 0.09, z), "lamp", color),
                box((0.1, 0.03, 0.14), (0, 0.015, z), "brushed_steel"),
            ]
        )
    arm = [[0, 0.02, z], [0, 0.1, z - 0.03], [0, 0.16, z + 0.03]]
    parts = [
        tube(arm, 0.009, "brushed_steel"),
        cylinder(0.045, 0.02, (0, 0, 0), "brushed_steel", 0, 14).rotated("x", -np.pi / 2).moved((0, 0, z)),
    ]
    return built([*parts, sphere(0.09, (0, 0.16, z + 0.12), "lamp", color)])


def wall_cabinet(rng: Rng) -> Built:
    """A distribution or first-aid box on the wall with trunking up from it."""
    width, height, z = rng.uniform(0.3, 0.6), rng.uniform(0.4, 0.8), rng.uniform(1.2, 1.5)
    color = tint(rng)
    parts = [
        box((width, 0.16, height), (0, 0.08, z), "painted_metal", color),
        box((width - 0.04, 0.012, height - 0.04), (0, 0.165, z), "painted_metal", color),
        box((0.03, 0.02, 0.06), (width / 2 - 0.06, 0.178, z), "black_plastic"),
        box((0.06, 0.04, 2.4 - z - height / 2), (0, 0.02, (2.4 + z + height / 2) / 2), "white_plastic"),
        box((0.1, 0.004, 0.1), (0, 0.173, z + height * 0.25), "sign_blue", 1),
    ]
    return built(parts)
