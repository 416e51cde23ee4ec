"""What buildings carry on their ceilings: lamps, air, water, power."""

from __future__ import annotations

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import Built, Rng, built, chance, pick, tint
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.primitives import (
    box,
    boxes,
    cylinder,
    lathe,
    rounded_box,
    sphere,
    torus,
    tube,
)


def panel_lamp(rng: Rng) -> Built:
    """A square or long panel of light set into the ceiling, or a louvred trough."""
    width, depth = pick(rng, ((0.6, 0.6), (1.2, 0.6), (1.2, 0.3)))
    color = tint(rng)
    parts = [
        boxes((width, 0.03, 0.03), [[0, s * (depth / 2 - 0.015), -0.015] for s in (-1, 1)], "white_plastic", color),
        boxes(
            (0.03, depth - 0.06, 0.03), [[s * (width / 2 - 0.015), 0, -0.015] for s in (-1, 1)], "white_plastic", color
        ),
        box((width - 0.06, depth - 0.06, 0.012), (0, 0, -0.008), "lamp", color),
    ]
    if chance(rng, 0.4):
        x = np.linspace(-width / 2 + 0.1, width / 2 - 0.1, int(width / 0.1))
        parts.append(boxes((0.006, depth - 0.06, 0.03), [[at, 0, -0.02] for at in x], "chrome"))
    return built(parts)


def tube_lamp(rng: Rng) -> Built:
    """A fluorescent batten, close to the ceiling or on wires."""
    length, drop = rng.uniform(1.2, 1.5), pick(rng, (0.0, 0.0, 0.35, 0.6))
    parts = [rounded_box((length, 0.09, 0.05), (0, 0, -drop - 0.025), 0.015, "white_plastic", tint(rng))]
    for y in (-0.025, 0.025):
        parts.append(
            tube([[-length / 2 + 0.03, y, -drop - 0.062], [length / 2 - 0.03, y, -drop - 0.062]], 0.014, "lamp")
        )
    if drop:
        parts += [
            tube([[s * length * 0.4, 0, -drop], [s * length * 0.4, 0, 0]], 0.003, "brushed_steel", 0, 4)
            for s in (-1, 1)
        ]
    return built(parts)


def pendant_lamp(rng: Rng) -> Built:
    """A lamp on a cord: a cone, a globe, a drum or a dome."""
    drop, color = rng.uniform(0.5, 1.0), tint(rng)
    kind = pick(rng, ("cone", "globe", "drum", "dome"))
    radius = rng.uniform(0.15, 0.28)
    parts = [
        tube([[0.0, 0.0, -drop], [0.0, 0.0, 0.0]], 0.004, "black_plastic", 0, 5),
        cylinder(0.05, 0.025, (0, 0, -0.025), "white_plastic", segments=14),
    ]
    at = (0.0, 0.0, -drop)
    metal = pick(rng, ("colored_metal", "black_metal", "brushed_steel"))
    if kind == "globe":
        parts.append(sphere(radius * 0.8, (0, 0, -drop - radius * 0.75), "lamp", color))
    elif kind == "drum":
        drum = [(radius, -0.2), (radius, 0.0), (radius - 0.004, 0.0), (radius - 0.004, -0.2)]
        parts.append(lathe(drum, "lampshade", color, at, 24))
        parts.append(cylinder(radius - 0.01, 0.004, (0, 0, -drop - 0.19), "lamp", 0, 24))
    else:
        bulge = 0.5 if kind == "cone" else 0.85
        shell = [(radius, -0.2), (radius * bulge, -0.09), (0.03, 0.0), (0, 0.0)]
        parts += [lathe(shell, metal, color, at, 24), sphere(0.05, (0, 0, -drop - 0.13), "lamp", 0, 12)]
    return built(parts)


def round_lamp(rng: Rng) -> Built:
    """A flat round lamp at the ceiling."""
    radius = rng.uniform(0.14, 0.26)
    dome = [(0, -0.09), (radius * 0.6, -0.08), (radius * 0.92, -0.045), (radius, 0.0)]
    return built([lathe(dome, "lamp", tint(rng), segments=24), torus(radius, 0.014, (0, 0, -0.015), "brushed_steel")])


def spot_track(rng: Rng) -> Built:
    """A rail with spot lamps."""
    length, count, color = rng.uniform(1.0, 2.0), int(rng.integers(3, 6)), tint(rng)
    metal = pick(rng, ("black_metal", "white_plastic"))
    parts = [box((length, 0.035, 0.03), (0, 0, -0.015), metal, color)]
    for x in np.linspace(-length / 2 + 0.1, length / 2 - 0.1, count):
        can = Mesh.merge(
            [
                cylinder(0.035, 0.12, (0, 0, -0.06), metal, color, 12),
                cylinder(0.03, 0.002, (0, 0, -0.063), "lamp", 0, 12),
            ]
        )
        parts.append(can.rotated("x", rng.uniform(-0.8, 0.8)).moved((x, 0, -0.13)))
        parts.append(cylinder(0.01, 0.1, (x, 0, -0.12), metal, color, 6))
    return built(parts)


def duct(rng: Rng) -> Built:
    """A ventilation duct below the ceiling along x: round with seams, or rectangular with flanges and an outlet."""
    length = rng.uniform(2.0, 4.0)
    if chance(rng, 0.5):
        radius = rng.uniform(0.12, 0.22)
        z = -radius - 0.08
        seams = np.arange(-length / 2, length / 2 + 0.01, 0.5)
        x = np.sort(np.concatenate([seams - 0.015, seams, seams + 0.015]))
        swell = np.where(np.arange(len(x)) % 3 == 1, radius + 0.012, radius)
        parts = [tube(np.column_stack([x, 0 * x, z + 0 * x]), swell, "galvanized", tint(rng), 18)]
        reach = radius
    else:
        width, height = rng.uniform(0.35, 0.6), rng.uniform(0.22, 0.35)
        z = -height / 2 - 0.08
        flanges = [[x, 0, z] for x in np.arange(-length / 2 + 0.05, length / 2, 0.9)]
        parts = [
            box((length, width, height), (0, 0, z), "galvanized", tint(rng)),
            boxes((0.03, width + 0.05, height + 0.05), flanges, "galvanized"),
        ]
        parts.append(box((0.4, 0.2, 0.03), (length * 0.2, 0, z - height / 2 - 0.01), "grille"))
        reach = height / 2
    hangers = [[x, 0, (z + reach) / 2] for x in (-length * 0.35, 0, length * 0.35)]
    return built([*parts, boxes((0.02, 0.02, abs(z + reach)), hangers, "black_metal")])


def pipe_run(rng: Rng) -> Built:
    """One to three pipes below the ceiling along x, with an elbow, couplings and clamps."""
    length, parts = rng.uniform(1.8, 3.5), []
    count = int(rng.integers(1, 4))
    for k in range(count):
        radius, y = rng.uniform(0.018, 0.05), 0.14 * (k - (count - 1) / 2)
        z, color = -0.09 - radius, tint(rng)
        material = pick(rng, ("galvanized", "colored_metal", "red_gloss", "white_plastic"))
        end = [
            [length / 2 - 0.1, y, z],
            [length / 2 - 0.03, y, z - 0.03],
            [length / 2, y, z - 0.1],
            [length / 2, y, z - 0.35],
        ]
        parts.append(tube([[-length / 2, y, z], *end], radius, material, color, 12))
        for x in (-length * 0.25, length * 0.2):
            parts.append(tube([[x - 0.03, y, z], [x + 0.03, y, z]], radius + 0.01, material, color, 12))
            parts.append(box((0.02, 0.02, -z), (x, y, z / 2), "black_metal"))
    return built(parts)


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


def cable_tray(rng: Rng) -> Built:
    """A tray of cables below the ceiling along x."""
    length, width, z = rng.uniform(1.8, 3.2), rng.uniform(0.15, 0.3), -rng.uniform(0.2, 0.35)
    rungs = [[x, 0, z] for x in np.arange(-length / 2, length / 2 + 0.01, 0.25)]
    parts = [
        boxes((length, 0.01, 0.06), [[0, s * width / 2, z + 0.02] for s in (-1, 1)], "galvanized"),
        boxes((0.03, width, 0.01), rungs, "galvanized"),
        boxes(
            (0.01, 0.01, -z),
            [[x, s * width / 2, z / 2] for x in (-length * 0.4, length * 0.4) for s in (-1, 1)],
            "galvanized",
        ),
    ]
    for _ in range(6):
        y = rng.uniform(-width * 0.4, width * 0.4, 6)
        path = np.column_stack([np.linspace(-length / 2, length / 2, 6), y, z + rng.uniform(0.015, 0.04, 6)])
        parts.append(
            tube(path, rng.uniform(0.006, 0.012), pick(rng, ("black_plastic", "plastic", "gray_plastic")), tint(rng), 6)
        )
    return built(parts)
