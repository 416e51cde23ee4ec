"""Screens and boards: what people look at and write on."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import Built, Rng, built, chance, pick, tint
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.primitives import box, boxes, cylinder, rounded_box, surface, tube


def _framed(width: float, height: float, inner: str, frame: str, rim: float, color: int, depth: float = 0.03) -> Mesh:
    """A face with a frame around it, its back at y = 0, its centre at z = 0, facing +y."""
    bars = [[0, depth / 2, s * (height - rim) / 2] for s in (-1, 1)]
    posts = [[s * (width - rim) / 2, depth / 2, 0] for s in (-1, 1)]
    return Mesh.merge(
        [
            box((width - rim, depth * 0.6, height - rim), (0, depth * 0.3, 0), inner, color),
            boxes((width, depth, rim), bars, frame, color),
            boxes((rim, depth, height - 2 * rim), posts, frame, color),
        ]
    )


def _display(width: float, height: float, color: int) -> Mesh:
    """A flat screen, its back at y = 0, its centre at z = 0, facing +y."""
    return Mesh.merge(
        [
            rounded_box((width, 0.03, height), (0, 0.035, 0), 0.008, "black_plastic", color),
            box((width * 0.6, 0.025, height * 0.6), (0, 0.0125, 0), "black_plastic", color),
            box((width - 0.025, 0.004, height - 0.025), (0, 0.05, 0), "screen", color),
        ]
    )


def tv_stand(rng: Rng) -> Built:
    """A large screen on a stand with castors."""
    width, color = rng.uniform(1.1, 1.7), tint(rng)
    height, middle = width * 0.57, rng.uniform(1.25, 1.5)
    metal = pick(rng, ("black_metal", "painted_metal"))
    parts = [
        _display(width, height, color).moved((0, 0, middle)),
        boxes((0.06, 0.05, middle), [[s * 0.18, -0.03, middle / 2 + 0.05] for s in (-1, 1)], metal, color),
        boxes((0.06, 0.62, 0.05), [[s * width * 0.3, 0, 0.085] for s in (-1, 1)], metal, color),
        box((width * 0.6, 0.06, 0.05), (0, -0.03, 0.085), metal, color),
        box((0.5, 0.32, 0.025), (0, 0.05, 0.72), metal, color),
    ]
    for a in (-1, 1):
        parts += [
            cylinder(0.03, 0.03, (0, 0, -0.015), "rubber", 0, 12)
            .rotated("x", np.pi / 2)
            .moved((a * width * 0.3, b * 0.28, 0.03))
            for b in (-1, 1)
        ]
    return built(parts)


def wall_screen(rng: Rng) -> Built:
    """A large screen hung on the wall."""
    width, color = rng.uniform(0.9, 1.8), tint(rng)
    return built([_display(width, width * 0.57, color).moved((0, 0.0, rng.uniform(1.35, 1.6)))])


def whiteboard_stand(rng: Rng) -> Built:
    """A whiteboard or flip chart on a rolling stand, written on."""
    width, height, color = rng.uniform(0.9, 1.6), rng.uniform(0.9, 1.1), tint(rng)
    middle, metal = rng.uniform(1.25, 1.4), pick(rng, ("painted_metal", "brushed_steel"))
    x = width / 2 + 0.02
    parts = [
        _framed(width, height, "whiteboard", metal, 0.03, color).moved((0, -0.015, middle)),
        boxes((0.035, 0.035, middle + 0.1), [[s * x, 0, (middle + 0.1) / 2 + 0.05] for s in (-1, 1)], metal, color),
        boxes((0.05, 0.6, 0.04), [[s * x, 0, 0.07] for s in (-1, 1)], metal, color),
        box((2 * x, 0.03, 0.04), (0, 0, 0.3), metal, color),
        box((width * 0.7, 0.08, 0.02), (0, 0.045, middle - height / 2 - 0.005), metal, color),
    ]
    pens = [[-0.1 + 0.07 * k, 0.06, middle - height / 2 + 0.015] for k in range(4)]
    parts.append(boxes((0.06, 0.016, 0.016), pens, "plastic", rng.integers(1 << 31, size=4)))
    for a in (-1, 1):
        parts += [rounded_box((0.03, 0.05, 0.05), (a * x, b * 0.27, 0.025), 0.012, "rubber") for b in (-1, 1)]
    return built(parts)


def wall_whiteboard(rng: Rng) -> Built:
    """A whiteboard on the wall with a tray of pens."""
    width, height, color = rng.uniform(1.2, 2.6), rng.uniform(0.9, 1.2), tint(rng)
    middle = rng.uniform(1.4, 1.55)
    tray = middle - height / 2 + 0.005
    parts = [
        _framed(width, height, "whiteboard", "brushed_steel", 0.025, color, 0.025).moved((0, 0, middle)),
        box((width * 0.6, 0.09, 0.015), (0, 0.06, tray), "brushed_steel"),
        boxes(
            (0.12, 0.018, 0.018),
            [[-0.2 + 0.15 * k, 0.07, tray + 0.016] for k in range(3)],
            "plastic",
            rng.integers(1 << 31, size=3),
        ),
        rounded_box((0.13, 0.05, 0.035), (width * 0.22, 0.065, tray + 0.025), 0.01, "black_plastic"),
    ]
    return built(parts)


def notice_board(rng: Rng) -> Built:
    """A pin board with notices."""
    width, height, color = rng.uniform(0.8, 1.8), rng.uniform(0.6, 1.1), tint(rng)
    frame = pick(rng, ("wood", "brushed_steel", "wood"))
    return built([_framed(width, height, "notices", frame, 0.03, color, 0.022).moved((0, 0, rng.uniform(1.4, 1.6)))])


def projector_screen(rng: Rng) -> Built:
    """A projection screen rolled down from its case, with its weighted bar."""
    width, drop = rng.uniform(1.6, 2.4), rng.uniform(1.2, 1.6)
    top = rng.uniform(2.3, 2.45)
    x = np.linspace(-width / 2, width / 2, 9)
    z = np.array([top - drop, top - drop / 2, top])
    grid = np.stack([*np.meshgrid(x, z)], -1)
    cloth = np.stack([grid[..., 0], 0.07 + 0.006 * np.cos(6 * grid[..., 0]), grid[..., 1]], -1)
    parts = [
        rounded_box((width + 0.15, 0.11, 0.11), (0, 0.06, top), 0.03, "white_plastic", tint(rng)),
        surface(cloth[::-1], pick(rng, ("white_plastic", "photograph", "paper")), tint(rng)),
        tube([[-width / 2, 0.07, top - drop], [width / 2, 0.07, top - drop]], 0.018, "black_plastic", segments=8),
    ]
    return built(parts)


def picture(rng: Rng) -> Built:
    """A framed picture: a painting, a poster or a photograph, with or without a mount."""
    width, height = rng.uniform(0.35, 1.3), rng.uniform(0.35, 1.0)
    color, motif = tint(rng), pick(rng, ("artwork", "photograph", "artwork"))
    frame = pick(rng, ("wood", "black_metal", "white_plastic", "brushed_steel"))
    parts = [_framed(width, height, motif, frame, rng.uniform(0.02, 0.06), color, rng.uniform(0.02, 0.04))]
    if chance(rng, 0.35) and min(width, height) > 0.5:
        mount = _framed(width - 0.08, height - 0.08, motif, "pages", 0.07, color, 0.03)
        parts.append(mount)
    return built([part.moved((0, 0, 1.55)) for part in parts])


def wall_mirror(rng: Rng) -> Built:
    """A mirror in a frame."""
    width, height = rng.uniform(0.4, 0.8), rng.uniform(0.7, 1.4)
    return built(
        [_framed(width, height, "mirror", pick(rng, ("wood", "brushed_steel")), 0.03, tint(rng)).moved((0, 0, 1.4))]
    )


def wall_sign(rng: Rng) -> Built:
    """A sign at a door or on a corridor wall."""
    width, height = rng.uniform(0.2, 0.6), rng.uniform(0.15, 0.4)
    return built(
        [rounded_box((width, 0.016, height), (0, 0.009, rng.uniform(1.5, 1.9)), 0.006, "sign_blue", tint(rng))]
    )


def monitor(rng: Rng) -> Built:
    """A computer screen on its foot, some on an arm, some curved."""
    width, color = rng.uniform(0.48, 0.8), tint(rng)
    height, lift = width * rng.uniform(0.5, 0.6), rng.uniform(0.1, 0.17)
    panel = _display(width, height, color)
    if width > 0.68:
        columns = np.linspace(-width / 2, width / 2, 9)
        slices = [
            box((width / 8, 0.03, height), ((a + b) / 2, 0.02, 0), "black_plastic", color) for a, b in pairwise(columns)
        ]
        slices += [
            box((width / 8, 0.003, height - 0.03), ((a + b) / 2, 0.036, 0), "screen", color)
            for a, b in pairwise(columns)
        ]
        panel = Mesh.merge(slices).deformed(
            lambda v: v + np.column_stack([0 * v[:, 0], 0.4 * v[:, 0] ** 2, 0 * v[:, 0]])
        )
    metal = pick(rng, ("black_plastic", "gray_plastic", "brushed_steel"))
    parts = [
        panel.moved((0, 0.02, lift + height / 2)),
        rounded_box((0.24, 0.19, 0.015), (0, 0, 0.0075), 0.007, metal, color),
        box((0.06, 0.03, lift + height * 0.5), (0, -0.02, (lift + height * 0.5) / 2), metal, color),
        box((0.06, 0.06, 0.06), (0, 0.01, lift + height * 0.48), metal, color),
    ]
    return built(parts)


def laptop(rng: Rng) -> Built:
    """An open notebook computer."""
    width, depth, color = rng.uniform(0.3, 0.37), rng.uniform(0.21, 0.25), tint(rng)
    material = pick(rng, ("brushed_steel", "black_plastic", "gray_plastic"))
    lid = Mesh.merge(
        [
            box((width, 0.008, depth), (0, 0, depth / 2), material, color),
            box((width - 0.02, 0.003, depth - 0.025), (0, 0.005, depth / 2), "screen", color),
        ]
    )
    parts = [
        rounded_box((width, depth, 0.018), (0, 0, 0.009), 0.006, material, color),
        box((width - 0.04, depth * 0.5, 0.003), (0, -depth * 0.12, 0.0185), "keyboard", color),
        box((0.1, 0.055, 0.002), (0, depth * 0.3, 0.0185), "gray_plastic", color),
        lid.rotated("x", rng.uniform(0.1, 0.5)).moved((0, -depth / 2, 0.018)),
    ]
    return built(parts)


def projector(rng: Rng) -> Built:
    """A projector hung from the ceiling, its lens to +y."""
    width, depth, height = rng.uniform(0.32, 0.42), rng.uniform(0.26, 0.34), rng.uniform(0.1, 0.15)
    drop, color = rng.uniform(0.25, 0.6), tint(rng)
    lens = cylinder(0.04, 0.05, (0, 0, 0), "black_gloss", 0, 16).rotated("x", -np.pi / 2)
    parts = [
        rounded_box(
            (width, depth, height),
            (0, 0, -drop - height / 2),
            0.02,
            pick(rng, ("white_plastic", "black_plastic")),
            color,
        ),
        cylinder(0.022, drop, (0, 0, -drop), "painted_metal", color, 12),
        box((0.16, 0.16, 0.02), (0, 0, -0.01), "painted_metal", color),
        lens.moved((width * 0.25, depth / 2 - 0.02, -drop - height / 2)),
        box((0.004, depth * 0.5, height * 0.5), (width / 2, 0, -drop - height / 2), "grille", color),
    ]
    return built(parts)
