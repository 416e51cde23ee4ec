"""Plants in their pots, and flowers."""

from __future__ import annotations

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import Built, Rng, built, chance, pick, tint
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.primitives import (
    ellipsoid,
    lathe,
    surface,
    tube,
)


def leaf(length: float, width: float, droop: float, color: int) -> Mesh:
    """A leaf from the origin towards +x, rising, then drooping; creased along its rib."""
    along = np.linspace(0, 1, 6)
    half = width / 2 * np.sin(np.pi * np.clip(along, 0.03, 0.99)) ** 0.7
    rise = length * (0.5 * along - droop * along**2)
    rows = np.stack(
        [np.column_stack([along * length * 0.9, s * half, rise + abs(s) * half * 0.35]) for s in (-1.0, 0.0, 1.0)]
    )
    return surface(rows[::-1], "leaves", color)


def _tuft(rng: Rng, at: tuple[float, float, float], count: int, length: float, width: float) -> list[Mesh]:
    """Leaves in all directions from one point."""
    color = tint(rng)
    shapes = [leaf(length * scale, width, rng.uniform(0.2, 0.9), color) for scale in rng.uniform(0.7, 1.1, 4)]
    parts = []
    for k in range(count):
        turned = shapes[k % 4].rotated("y", rng.uniform(-1.2, 0.2)).rotated("z", 2.4 * k + rng.uniform(-0.3, 0.3))
        parts.append(turned.moved(at))
    return parts


def _pot(rng: Rng, radius: float, height: float) -> Mesh:
    material, color = pick(rng, ("terracotta", "ceramic", "wicker", "glazed_pattern", "gray_plastic")), tint(rng)
    foot = radius * rng.uniform(0.6, 0.95)
    outside = [
        (0, 0),
        (foot, 0),
        ((foot + radius) / 2 * rng.uniform(0.98, 1.12), height * 0.5),
        (radius, height - 0.02),
    ]
    rim = [
        (radius + 0.01, height - 0.02),
        (radius + 0.01, height),
        (radius - 0.015, height),
        (radius - 0.03, height - 0.05),
    ]
    earth = lathe([(radius - 0.02, height - 0.05), (0, height - 0.04)], "soil", color, segments=16)
    return Mesh.merge([lathe([*outside, *rim], material, color), earth])


def plant(rng: Rng) -> Built:
    """A pot plant on the floor: a small tree, a palm, or a bush of broad leaves."""
    kind, radius, pot = pick(rng, ("tree", "palm", "bush")), rng.uniform(0.14, 0.22), rng.uniform(0.26, 0.42)
    parts = [_pot(rng, radius, pot)]
    if kind == "tree":
        top = pot + rng.uniform(0.7, 1.1)
        stem = [[0, 0, pot - 0.05], [rng.uniform(-0.05, 0.05), 0.02, (pot + top) / 2], [0, 0, top]]
        parts.append(tube(stem, [0.025, 0.02, 0.012], "bark", tint(rng), 7))
        for _ in range(11):
            at = (rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), top + rng.uniform(-0.3, 0.2))
            parts.append(tube(np.array([(0, 0, top - 0.25), at]), 0.006, "bark", segments=5))
            parts += _tuft(rng, at, 8, 0.17, 0.075)
    elif kind == "palm":
        for _ in range(int(rng.integers(1, 4))):
            top = pot + rng.uniform(0.3, 0.9)
            x, y = rng.uniform(-0.08, 0.08, 2)
            parts.append(tube([[x / 2, y / 2, pot - 0.05], [x, y, top]], [0.03, 0.022], "bark", tint(rng), 7))
            parts += _tuft(rng, (x, y, top), 16, rng.uniform(0.45, 0.6), 0.06)
    else:
        for _ in range(int(rng.integers(12, 20))):
            angle, lean, length = rng.uniform(0, 2 * np.pi), rng.uniform(0.05, 0.3), rng.uniform(0.2, 0.65)
            tip = [lean * np.cos(angle), lean * np.sin(angle), pot + length]
            parts.append(tube([[0.3 * tip[0], 0.3 * tip[1], pot - 0.05], tip], 0.006, "leaves", 3, 5))
            blade = leaf(0.28, 0.17, rng.uniform(0.4, 1.0), 5).rotated("z", angle + rng.uniform(-0.4, 0.4))
            parts.append(blade.moved(tip))
    return built(parts)


def desk_plant(rng: Rng) -> Built:
    """A small pot plant or a cactus."""
    radius, pot = rng.uniform(0.05, 0.08), rng.uniform(0.08, 0.13)
    parts = [_pot(rng, radius, pot)]
    if chance(rng, 0.3):
        parts.append(ellipsoid((radius * 0.7, radius * 0.7, 0.09), (0, 0, pot + 0.05), "leaves", tint(rng), 12))
    else:
        parts += _tuft(rng, (0.0, 0.0, pot - 0.02), 14, rng.uniform(0.16, 0.28), rng.uniform(0.025, 0.06))
    lifted = Mesh.merge(parts).deformed(lambda v: np.maximum(v, [-np.inf, -np.inf, 0.0]))
    return Built(lifted)


def vase(rng: Rng) -> Built:
    """A vase, some with flowers."""
    height, radius = rng.uniform(0.18, 0.34), rng.uniform(0.05, 0.09)
    neck = radius * rng.uniform(0.35, 0.8)
    profile = [
        (0, 0),
        (radius * 0.7, 0),
        (radius, height * 0.3),
        (radius * 0.95, height * 0.5),
        (neck, height * 0.8),
        (neck * 1.25, height),
        (neck, height),
        (neck * 0.8, height * 0.8),
    ]
    parts = [lathe(profile, pick(rng, ("ceramic", "glazed_pattern", "terracotta")), tint(rng), segments=18)]
    if chance(rng, 0.6):
        color = tint(rng)
        for _ in range(int(rng.integers(4, 9))):
            angle, lean = rng.uniform(0, 2 * np.pi), rng.uniform(0.03, 0.12)
            tip = np.array([lean * np.cos(angle), lean * np.sin(angle), height + rng.uniform(0.1, 0.22)])
            parts.append(tube(np.array([(0, 0, height * 0.7), tip]), 0.004, "leaves", 3, 5))
            parts.append(ellipsoid((0.03, 0.03, 0.02), tip, "plastic", color, 8))
    return built(parts)
