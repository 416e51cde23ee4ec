"""What stands about on floors: lamps, bins, coats, screens to part rooms, bicycles, bags."""

from __future__ import annotations

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import Built, Rng, Top, arc_band, built, chance, pick, tint, tints
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.primitives import (
    box,
    boxes,
    cylinder,
    ellipsoid,
    frustum,
    lathe,
    prism,
    rounded_box,
    sphere,
    surface,
    torus,
    tube,
)


def floor_lamp(rng: Rng) -> Built:
    """A lamp on a tall post: a shade, an arc over to one side, or an uplighter's bowl."""
    height, metal, color = (
        rng.uniform(1.5, 1.8),
        pick(rng, ("black_metal", "brushed_steel", "painted_metal")),
        tint(rng),
    )
    parts = [lathe([(0, 0), (0.15, 0), (0.15, 0.015), (0.03, 0.035), (0, 0.035)], metal, color)]
    kind = pick(rng, ("shade", "arc", "bowl"))
    if kind == "arc":
        angle = np.linspace(np.pi, 0.25, 10)
        bow = np.column_stack([0.32 + 0.32 * np.cos(angle), 0 * angle, height - 0.3 + 0.3 * np.sin(angle)])
        parts.append(tube(np.concatenate([[[0, 0, 0.02]], bow]), 0.012, metal, color))
        tip = bow[-1]
        parts.append(lathe([(0.15, -0.12), (0.12, -0.02), (0.03, 0.03), (0, 0.03)], metal, color, tip))
        parts.append(sphere(0.05, (tip[0], 0, tip[2] - 0.06), "lamp"))
        return built(parts)
    parts.append(cylinder(0.012, height - 0.1, (0, 0, 0.03), metal, color, 8))
    if kind == "shade":
        low, high = rng.uniform(0.18, 0.25), rng.uniform(0.12, 0.18)
        shade = [(low, height - 0.3), (high, height), (high - 0.004, height), (low - 0.004, height - 0.3)]
        parts.append(lathe(shade, "lampshade", color))
        parts.append(sphere(0.045, (0, 0, height - 0.17), "lamp"))
    else:
        parts.append(
            lathe(
                [(0.02, height - 0.1), (0.13, height - 0.06), (0.18, height), (0.17, height), (0, height - 0.06)],
                metal,
                color,
            )
        )
    return built(parts)


def waste_bin(rng: Rng) -> Built:
    """A round bin: an open basket, or a taller one with a domed lid."""
    radius, height, color = rng.uniform(0.12, 0.18), rng.uniform(0.28, 0.42), tint(rng)
    material = pick(rng, ("black_plastic", "gray_plastic", "painted_metal", "wicker", "plastic", "brushed_steel"))
    if chance(rng, 0.3):
        tall = height * 1.6
        parts = [
            cylinder(radius, tall, (0, 0, 0), material, color),
            ellipsoid((radius, radius, 0.1), (0, 0, tall), "black_plastic"),
        ]
        parts.append(rounded_box((radius, 0.1, 0.03), (0, radius, 0.02), 0.01, "black_plastic"))
        return built(parts)
    foot = radius * 0.8
    profile = [(0, 0), (foot, 0), (radius, height), (radius - 0.008, height), (foot - 0.005, 0.012), (0, 0.012)]
    parts = [lathe(profile, material, color, segments=24), torus(radius, 0.008, (0, 0, height), material, color)]
    for _ in range(int(rng.integers(0, 6))):
        spot = (*rng.uniform(-0.07, 0.07, 2), height * rng.uniform(0.3, 0.8))
        parts.append(ellipsoid((0.045, 0.04, 0.04), spot, "paper", tint(rng), 8, 0.7))
    return built(parts)


def coat_stand(rng: Rng) -> Built:
    """A post with hooks, a coat or two on them."""
    height, material, color = rng.uniform(1.65, 1.85), pick(rng, ("wood", "black_metal", "chrome")), tint(rng)
    parts = [
        tube([[0, 0, 0.03], [0, 0, height]], 0.02, material, color),
        sphere(0.032, (0, 0, height), material, color, 10),
    ]
    for k in range(4):
        turn = k * np.pi / 2 + 0.4
        out = np.array([np.cos(turn), np.sin(turn)])
        foot = tube([[*(out * 0.28), 0.014], [*(out * 0.15), 0.05], [0, 0, 0.2]], 0.014, material, color, 6)
        parts.append(foot)
        hook = [[0, 0, height - 0.2], [*(out * 0.1), height - 0.18], [*(out * 0.15), height - 0.08]]
        parts.append(tube(hook, 0.009, material, color, 6))
        if chance(rng, 0.45):
            parts.append(_coat(rng).moved((*(out * 0.17), height - 0.13), turn + np.pi / 2))
    return built(parts)


def _coat(rng: Rng) -> Mesh:
    """A coat hanging down from the origin, in folds."""
    length, color = rng.uniform(0.75, 1.05), tint(rng)
    z = np.linspace(0.0, 1.0, 7)
    angle = 2 * np.pi * np.arange(16) / 16
    half = 0.05 + 0.16 * np.sqrt(z)
    folds = 1 + 0.16 * z[:, None] * np.sin(5 * angle)[None, :]
    x, y = half[:, None] * np.cos(angle) * folds, (0.035 + 0.035 * z)[:, None] * np.sin(angle) * folds
    grid = np.stack([x, y, np.broadcast_to(-length * z[:, None], x.shape)], -1)
    return surface(grid[::-1], pick(rng, ("fabric", "leather", "patterned_fabric")), color, closed=True)


def partition(rng: Rng) -> Built:
    """A cloth partition screen, straight, folded or bent, on feet."""
    height, width, color = rng.uniform(1.3, 1.8), rng.uniform(1.2, 1.8), tint(rng)
    cloth = pick(rng, ("fabric", "patterned_fabric", "fabric"))
    kind = pick(rng, ("straight", "bent", "folded"))
    if kind == "bent":
        radius = width / 1.1
        band = arc_band(radius, 0.05, np.pi / 2 - 0.55, np.pi / 2 + 0.55, 12) - [0, radius]
        return built([prism(band, 0.03, height, cloth, color), prism(band, 0.0, 0.03, "painted_metal", color)])
    leaves = 1 if kind == "straight" else 3
    leaf_width, turn = width / leaves, 0.0 if leaves == 1 else 0.5
    parts, x = [], -width / 2
    for k in range(leaves):
        angle = turn * (-1) ** k
        panel = Mesh.merge(
            [
                rounded_box(
                    (leaf_width - 0.04, 0.04, height - 0.1), (0, 0, 0.08 + (height - 0.1) / 2), 0.015, cloth, color
                ),
                boxes((0.02, 0.05, height), [[s * leaf_width / 2, 0, height / 2] for s in (-1, 1)], "brushed_steel"),
                *(
                    rounded_box(
                        (0.06, 0.36, 0.03), (s * (leaf_width / 2 - 0.06), 0, 0.015), 0.01, "painted_metal", color
                    )
                    for s in (-1, 1)
                ),
            ]
        )
        step = leaf_width * np.cos(angle)
        parts.append(panel.moved((x + step / 2, 0, 0), angle))
        x += step
    return built(parts)


def bicycle(rng: Rng) -> Built:
    """A bicycle on its stand, along x."""
    color, radius = tint(rng), rng.uniform(0.31, 0.35)
    front, back = np.array([0.52, 0.0, radius + 0.015]), np.array([-0.5, 0.0, radius + 0.015])
    parts = []
    for hub in (front, back):
        angle = 2 * np.pi * np.arange(28) / 28
        circle = np.column_stack([radius * np.cos(angle), 0 * angle, radius * np.sin(angle)]) + hub
        parts.append(tube(circle, 0.015, "rubber", 0, 6, closed=True))
        parts += [tube([hub, circle[k]], 0.002, "chrome", 0, 4) for k in range(0, 28, 4)]
        parts.append(tube([hub - [0, 0.05, 0], np.add(hub, (0, 0.05, 0))], 0.02, "chrome"))
    pedal, seat, head, steer = (
        np.array([-0.08, 0, 0.28]),
        np.array([-0.2, 0, 0.8]),
        np.array([0.36, 0, 0.78]),
        np.array([0.32, 0, 0.95]),
    )
    frame = [
        (pedal, seat),
        (seat * [1, 1, 0.95], head),
        (pedal, head * [1, 1, 0.9]),
        (steer, front),
        (pedal, back),
        (seat * [1, 1, 0.93], back),
    ]
    parts += [tube(pair, 0.017, "colored_metal", color, 7) for pair in frame]
    bar = np.array([[0.02, 0.28, 0.04], [0.06, 0.12, 0.06], [0.06, -0.12, 0.06], [0.02, -0.28, 0.04]])
    parts += [
        tube(bar + steer, 0.012, "chrome", 0, 6),
        tube([seat, np.add(seat, (-0.03, 0, 0.12))], 0.013, "chrome", 0, 6),
        ellipsoid((0.13, 0.07, 0.035), np.add(seat, (-0.03, 0, 0.14)), "leather", color, 12),
        tube([np.add(pedal, (0.0, -0.1, -0.14)), pedal, np.add(pedal, (0.0, 0.1, 0.14))], 0.01, "black_metal", 0, 6),
        boxes((0.09, 0.06, 0.02), [np.add(pedal, (0, -0.12, -0.14)), np.add(pedal, (0, 0.12, 0.14))], "rubber"),
        tube([back * [0.8, 1, 1], np.array([-0.35, 0.16, 0.008])], 0.008, "black_metal", 0, 6),
    ]
    return built(parts)


def pedestal(rng: Rng) -> Built:
    """A plinth or side table with one leg, to put a vase or a lamp on."""
    height, color = rng.uniform(0.5, 1.0), tint(rng)
    if chance(rng, 0.5):
        side = rng.uniform(0.28, 0.4)
        column = box((side, side, height), (0, 0, height / 2), pick(rng, ("marble", "wood", "board")), color)
        return built([column], Top((0.0, 0.0), (side - 0.06, side - 0.06), height))
    radius = rng.uniform(0.2, 0.28)
    parts = [
        frustum(radius * 0.8, 0.03, 0.03, (0, 0, 0), "black_metal"),
        cylinder(0.022, height - 0.04, (0, 0, 0.02), "black_metal", segments=10),
    ]
    parts.append(cylinder(radius, 0.025, (0, 0, height - 0.025), pick(rng, ("wood", "marble")), color, 24))
    return built(parts, Top((0.0, 0.0), (radius * 1.2, radius * 1.2), height))


def backpack(rng: Rng) -> Built:
    """A backpack on the floor, leaning a little, with pocket and straps."""
    height, color = rng.uniform(0.4, 0.52), tint(rng)
    material = pick(rng, ("fabric", "leather", "fabric"))
    body = ellipsoid((0.16, 0.1, height / 2), (0, 0, height / 2), material, color, 18, 0.45)
    pocket = ellipsoid((0.12, 0.06, height * 0.2), (0, 0.1, height * 0.28), material, color, 14, 0.5)
    parts = [
        body.deformed(lambda v: np.column_stack([v[:, 0] * (1 - 0.25 * (v[:, 2] / height) ** 3), v[:, 1], v[:, 2]])),
        pocket,
    ]
    for s in (-1, 1):
        strap = [
            [s * 0.07, -0.08, height * 0.9],
            [s * 0.09, -0.16, height * 0.65],
            [s * 0.1, -0.15, height * 0.3],
            [s * 0.12, -0.08, 0.06],
        ]
        parts.append(tube(strap, 0.014, "black_plastic", segments=6))
    parts.append(
        tube(
            [[-0.04, -0.03, height - 0.01], [0, -0.04, height + 0.05], [0.04, -0.03, height - 0.01]],
            0.008,
            "black_plastic",
            segments=6,
        )
    )
    return built(parts)


def shoes(rng: Rng) -> Built:
    """A pair of shoes."""
    color, material = tint(rng), pick(rng, ("leather", "fabric", "rubber"))
    parts = []
    for s in (-1, 1):
        sole = rounded_box((0.095, 0.28, 0.025), (0, 0, 0.0125), 0.012, "rubber", 1)
        toe = ellipsoid((0.046, 0.1, 0.045), (0, 0.045, 0.045), material, color, 12, 0.8)
        heel = lathe(
            [(0.042, 0.02), (0.042, 0.07), (0.038, 0.1), (0.03, 0.1), (0.03, 0.05)], material, color, (0, -0.09, 0), 12
        )
        parts.append(
            Mesh.merge([sole, toe, heel]).moved((s * 0.075, rng.uniform(-0.04, 0.04), 0), s * rng.uniform(-0.1, 0.25))
        )
    return built(parts)


def umbrella_stand(rng: Rng) -> Built:
    """A tall vessel with umbrellas in it."""
    parts = [
        lathe(
            [(0, 0), (0.11, 0), (0.12, 0.45), (0.11, 0.45), (0.1, 0.02), (0, 0.02)],
            pick(rng, ("ceramic", "brushed_steel", "wicker")),
            tint(rng),
        )
    ]
    for color in tints(rng, int(rng.integers(1, 4))):
        lean = rng.uniform(-0.08, 0.08, 2)
        stick = [[*(lean * 0.3), 0.03], [*(lean * 0.9), 0.55], [*lean, 0.75], [lean[0] + 0.03, lean[1], 0.8]]
        parts.append(tube(stick, [0.012, 0.035, 0.012, 0.011], "fabric", int(color), 8))
    return built(parts)
