"""Small things that stand on tables and shelves."""

from __future__ import annotations

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import Built, Rng, built, chance, pick, tint, tints
from pcdbench.datasets.synthetic.furniture.storage import books_row
from pcdbench.datasets.synthetic.primitives import (
    box,
    boxes,
    cylinder,
    ellipsoid,
    frustum,
    lathe,
    rounded_box,
    sphere,
    tube,
)


def keyboard(rng: Rng) -> Built:
    """A keyboard, and mostly a mouse to its right."""
    color, width = tint(rng), rng.uniform(0.3, 0.45)
    material = pick(rng, ("black_plastic", "white_plastic", "gray_plastic"))
    parts = [
        rounded_box((width, 0.14, 0.02), (0, 0, 0.01), 0.008, material, color),
        box((width - 0.02, 0.115, 0.006), (0, 0, 0.022), "keyboard", color),
    ]
    if chance(rng, 0.8):
        parts.append(
            ellipsoid(
                (0.032, 0.055, 0.02), (-width / 2 - 0.1, rng.uniform(-0.02, 0.02), 0.018), material, color, 12
            ).deformed(lambda v: np.maximum(v, [-9, -9, 0.0]))
        )
    return built(parts)


def book_pile(rng: Rng) -> Built:
    """Books lying on each other, each turned a little."""
    parts, z = [], 0.0
    for color in tints(rng, int(rng.integers(2, 7))):
        width, depth, thick = rng.uniform(0.14, 0.24), rng.uniform(0.2, 0.3), rng.uniform(0.015, 0.05)
        cover = boxes((width, depth, 0.004), [[0, 0, 0.002], [0, 0, thick - 0.002]], "book_cover", color)
        spine = box((0.004, depth, thick), (-width / 2, 0, thick / 2), "book_cover", int(color))
        inner = box((width - 0.01, depth - 0.012, thick - 0.006), (0.0, 0, thick / 2), "pages", int(color))
        turn = rng.uniform(-0.35, 0.35)
        parts += [part.moved((0, 0, z), turn) for part in (cover, spine, inner)]
        z += thick
    return built(parts)


def book_row(rng: Rng) -> Built:
    """A row of upright books between two ends."""
    width = rng.uniform(0.25, 0.6)
    books = books_row(rng, width, rng.uniform(0.22, 0.3), 0.2).moved((-width / 2, 0.09, 0))
    ends = boxes((0.004, 0.12, 0.16), [[s * (width / 2 + 0.004), 0, 0.08] for s in (-1, 1)], "painted_metal", tint(rng))
    return built([books, ends])


def mug(rng: Rng) -> Built:
    """A mug with its handle."""
    radius, height, color = rng.uniform(0.036, 0.046), rng.uniform(0.085, 0.12), tint(rng)
    material = pick(rng, ("ceramic", "glazed_pattern"))
    profile = [
        (0, 0),
        (radius * 0.9, 0),
        (radius, 0.01),
        (radius, height),
        (radius - 0.005, height),
        (radius - 0.006, 0.02),
        (0, 0.02),
    ]
    handle = [
        [radius - 0.003, 0, height * 0.8],
        [radius + 0.025, 0, height * 0.75],
        [radius + 0.028, 0, height * 0.4],
        [radius - 0.003, 0, height * 0.25],
    ]
    return built([lathe(profile, material, color, segments=18), tube(handle, 0.006, material, color, 6)])


def bottle(rng: Rng) -> Built:
    """A drinking bottle."""
    radius, height, color = rng.uniform(0.032, 0.045), rng.uniform(0.2, 0.31), tint(rng)
    profile = [
        (0, 0),
        (radius, 0),
        (radius, height * 0.62),
        (radius * 0.4, height * 0.85),
        (radius * 0.38, height * 0.93),
        (0, height * 0.93),
    ]
    material = pick(rng, ("plastic", "brushed_steel", "clear_plastic", "colored_metal"))
    parts = [
        lathe(profile, material, color, segments=16),
        cylinder(radius * 0.45, height * 0.08, (0, 0, height * 0.92), "plastic", tint(rng), 12),
    ]
    if chance(rng, 0.5):
        parts.append(cylinder(radius + 0.0015, height * 0.25, (0, 0, height * 0.25), "artwork", color, 16))
    return built(parts)


def paper_stack(rng: Rng) -> Built:
    """Piles of paper, loosely laid, or a stack of trays."""
    if chance(rng, 0.35):
        color, trays = tint(rng), int(rng.integers(2, 4))
        levels = 0.065 * np.arange(trays)
        parts = [boxes((0.26, 0.34, 0.004), [[0, 0, z + 0.002] for z in levels], "plastic", color)]
        parts.append(
            boxes((0.004, 0.34, 0.05), [[s * 0.13, 0, z + 0.025] for z in levels for s in (-1, 1)], "plastic", color)
        )
        parts.append(boxes((0.21, 0.29, 0.02), [[0, 0.01, z + 0.014] for z in levels], "paper", tints(rng, trays)))
        posts = [[a * 0.13, b * 0.16, 0.0325 * trays] for a in (-1, 1) for b in (-1, 1)]
        return built([*parts, boxes((0.012, 0.012, 0.065 * trays), posts, "plastic", color)])
    parts, z = [], 0.0
    for color in tints(rng, int(rng.integers(2, 6))):
        thick = rng.uniform(0.003, 0.03)
        sheet = box((0.21, 0.297, thick), (0, 0, thick / 2), "paper", int(color))
        parts.append(sheet.moved((*rng.uniform(-0.03, 0.03, 2), z), rng.uniform(-0.25, 0.25)))
        z += thick
    return built(parts)


def desk_lamp(rng: Rng) -> Built:
    """An articulated lamp, or a small one with a shade."""
    metal, color = pick(rng, ("black_metal", "colored_metal", "chrome")), tint(rng)
    if chance(rng, 0.4):
        height = rng.uniform(0.35, 0.5)
        shade = [(0.13, height - 0.18), (0.08, height), (0.076, height), (0.126, height - 0.18)]
        body = [
            (0, 0),
            (0.07, 0),
            (0.07, 0.01),
            (0.03, 0.05),
            (0.045, 0.12),
            (0.015, 0.2),
            (0.012, height - 0.08),
            (0, height - 0.08),
        ]
        return built(
            [
                lathe(body, pick(rng, ("ceramic", "wood", "brushed_steel")), color),
                lathe(shade, "lampshade", color),
                sphere(0.035, (0, 0, height - 0.1), "lamp"),
            ]
        )
    elbow = [-rng.uniform(0.08, 0.15), 0.0, rng.uniform(0.28, 0.35)]
    head = [rng.uniform(0.1, 0.17), 0.0, rng.uniform(0.38, 0.48)]
    bell = lathe([(0.075, -0.1), (0.06, -0.03), (0.02, 0.02), (0, 0.02)], metal, color).rotated("y", -0.5)
    parts = [
        lathe([(0, 0), (0.09, 0), (0.09, 0.012), (0.02, 0.025), (0, 0.025)], metal, color),
        tube([[0, 0, 0.02], elbow], 0.008, metal, color, 6),
        tube([elbow, head], 0.008, metal, color, 6),
        sphere(0.014, elbow, metal, color, 8),
        bell.moved(head),
        sphere(0.03, (head[0] + 0.03, 0, head[2] - 0.055), "lamp", 0, 10),
    ]
    return built([part.rotated("z", -np.pi / 2) for part in parts])


def telephone(rng: Rng) -> Built:
    """A desk telephone with its handset."""
    material, color = pick(rng, ("black_plastic", "gray_plastic")), tint(rng)
    body = box((0.19, 0.2, 0.05), (0, 0, 0.025), material, color).deformed(
        lambda v: np.column_stack([v[:, :2], v[:, 2] * (1.2 - 2.5 * v[:, 1])])
    )
    keys = [[0.02 + 0.024 * a, 0.06 - 0.024 * b, 0.055 + 0.006 * b] for a in range(3) for b in range(4)]
    receiver = [[0.06, 0.08, 0.045], [0.06, 0.05, 0.085], [0.06, -0.06, 0.105], [0.06, -0.09, 0.09]]
    parts = [
        body,
        boxes((0.016, 0.016, 0.012), np.array(keys) * [-1, 1, 1], "white_plastic"),
        box((0.09, 0.05, 0.004), (-0.035, -0.055, 0.078), "screen", color),
        tube(receiver, [0.024, 0.014, 0.014, 0.024], material, color),
    ]
    size = rng.uniform(0.9, 1.1)
    return built([part.scaled(size) for part in parts])


def pen_cup(rng: Rng) -> Built:
    """A cup of pens."""
    parts = [
        lathe(
            [(0, 0), (0.04, 0), (0.04, 0.1), (0.037, 0.1), (0.037, 0.01), (0, 0.01)],
            pick(rng, ("black_metal", "ceramic", "wood")),
            tint(rng),
            segments=14,
        )
    ]
    for color in tints(rng, int(rng.integers(3, 8))):
        lean = rng.uniform(-0.035, 0.035, 2)
        parts.append(
            tube([[*(lean * 0.4), 0.012], [*(lean * 1.3), rng.uniform(0.14, 0.18)]], 0.004, "plastic", int(color), 5)
        )
    return built(parts)


def bowl(rng: Rng) -> Built:
    """A bowl of fruit."""
    radius, color = rng.uniform(0.1, 0.16), tint(rng)
    profile = [
        (0, 0),
        (radius * 0.45, 0),
        (radius * 0.8, radius * 0.25),
        (radius, radius * 0.6),
        (radius - 0.008, radius * 0.6),
        (radius * 0.7, radius * 0.25),
        (0, 0.02),
    ]
    parts = [lathe(profile, pick(rng, ("ceramic", "wood", "glazed_pattern")), color)]
    for k in range(int(rng.integers(3, 7))):
        angle = 2.2 * k
        reach = radius * (0.45 if k < 5 else 0.0)
        spot = (reach * np.cos(angle), reach * np.sin(angle), radius * (0.5 if k < 5 else 0.85))
        parts.append(sphere(0.038, spot, pick(rng, ("plastic", "leaves", "red_gloss")), tint(rng), 10))
    return built(parts)


def small_box(rng: Rng) -> Built:
    """A box, tin or parcel."""
    size = (rng.uniform(0.12, 0.32), rng.uniform(0.1, 0.24), rng.uniform(0.06, 0.2))
    material = pick(rng, ("cardboard", "artwork", "plastic", "cardboard", "wood"))
    return built([rounded_box(size, (0, 0, size[2] / 2), 0.006, material, tint(rng), 1)])


def kettle(rng: Rng) -> Built:
    """An electric kettle on its base."""
    material, color, height = (
        pick(rng, ("brushed_steel", "white_plastic", "black_plastic", "red_gloss")),
        tint(rng),
        rng.uniform(0.2, 0.25),
    )
    handle = [[-0.06, 0, height - 0.02], [-0.13, 0, height - 0.01], [-0.135, 0, height * 0.5], [-0.075, 0, 0.06]]
    parts = [
        cylinder(0.08, 0.02, (0, 0, 0), "black_plastic"),
        lathe([(0, 0.02), (0.082, 0.02), (0.08, height * 0.5), (0.058, height), (0, height + 0.01)], material, color),
        tube(handle, 0.013, "black_plastic", segments=7),
        frustum(0.03, 0.01, 0.05, (0, 0, 0), material, color, 10).rotated("y", 1.0).moved((0.05, 0, height * 0.75)),
        sphere(0.014, (0, 0, height + 0.015), "black_plastic", 0, 8),
    ]
    return built(parts)
