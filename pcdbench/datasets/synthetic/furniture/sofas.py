"""Upholstered seats: sofas, armchairs, cushions."""

from __future__ import annotations

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import (
    Built,
    Rng,
    Top,
    arc_band,
    built,
    chance,
    pick,
    tint,
)
from pcdbench.datasets.synthetic.mesh import Floats
from pcdbench.datasets.synthetic.primitives import (
    box,
    boxes,
    cylinder,
    ellipsoid,
    prism,
    sphere,
    surface,
    tube,
)

_CLOTH = ("fabric", "fabric", "leather", "patterned_fabric")


def sofa(rng: Rng) -> Built:
    """A sofa for two to four: seat and back cushions, round arms, a gently bent back, loose cushions."""
    seats = int(rng.integers(2, 4))
    return _couch(rng, seats, rng.uniform(0.58, 0.7))


def armchair(rng: Rng) -> Built:
    """A single couch or a tub chair, whose back wraps around its seat."""
    if chance(rng, 0.5):
        return _couch(rng, 1, rng.uniform(0.58, 0.68))
    cloth, color = pick(rng, _CLOTH), tint(rng)
    radius, height = rng.uniform(0.28, 0.32), rng.uniform(0.68, 0.8)

    def sloped(vertices: Floats) -> Floats:
        rise = np.clip((vertices[:, 1] + radius) / (2 * radius), 0, 1)
        keep = 1 - 0.28 * rise * (vertices[:, 2] > 0.3)
        swell = 1 + 0.1 * (vertices[:, 2] / height)
        return np.column_stack([vertices[:, :2] * swell[:, None], vertices[:, 2] * keep])

    shell = prism(arc_band(radius, 0.09, np.pi * 0.87, np.pi * 2.13, 16), 0.12, height, cloth, color).deformed(sloped)
    angles = np.linspace(np.pi * 0.87, np.pi * 2.13, 16)
    rim = np.column_stack([(radius + 0.045) * np.cos(angles), (radius + 0.045) * np.sin(angles), np.full(16, height)])
    parts = [
        shell,
        tube(sloped(rim), 0.05, cloth, color),
        cylinder(radius, 0.2, (0, 0, 0.12), cloth, color, 24),
        ellipsoid((radius, radius + 0.03, 0.085), (0, 0.04, 0.38), cloth, color, 20, squareness=0.8),
    ]
    parts += [cylinder(0.018, 0.13, (a * 0.22, b * 0.22, 0), "wood", color, 8) for a in (-1, 1) for b in (-1, 1)]
    return built(parts)


def _couch(rng: Rng, seats: int, seat_width: float) -> Built:
    cloth, color = pick(rng, _CLOTH), tint(rng)
    depth, seat_height, back_height = rng.uniform(0.82, 0.95), rng.uniform(0.4, 0.46), rng.uniform(0.76, 0.92)
    arm = rng.uniform(0.14, 0.24)
    inner = seats * seat_width
    width = inner + 2 * arm
    back = -depth / 2
    bend = rng.uniform(0.0, 0.07)

    def bent(vertices: Floats) -> Floats:
        share = np.clip(vertices[:, 2] / back_height, 0, 1)
        shift = -bend * (1 - (2 * vertices[:, 0] / width) ** 2) - 0.08 * share
        return np.column_stack([vertices[:, 0], vertices[:, 1] + shift, vertices[:, 2]])

    columns = np.linspace(-width / 2, width / 2, 8 * seats + 1)
    outline = np.array(
        [
            (back + 0.08, 0.1),
            (back + 0.2, 0.1),
            (back + 0.2, back_height - 0.05),
            (back + 0.17, back_height),
            (back + 0.11, back_height),
            (back + 0.08, back_height - 0.05),
        ]
    )
    rows = np.stack([np.column_stack([np.full(6, x), outline]) for x in columns])
    caps = [np.tile(rows[k].mean(axis=0), (1, 6, 1)) for k in (0, -1)]
    parts = [
        surface(np.concatenate([caps[0], rows, caps[1]])[::-1, ::-1], cloth, color, closed=True).deformed(bent),
        box((inner, depth - 0.1, seat_height - 0.24), (0, 0.04, 0.1 + (seat_height - 0.24) / 2), cloth, color),
    ]
    for k in range(seats):
        x = (k - (seats - 1) / 2) * seat_width
        cushion = ellipsoid(
            (seat_width / 2, (depth - 0.2) / 2, 0.1), (x, 0.11, seat_height - 0.08), cloth, color, 20, 0.35
        )
        parts.append(cushion)
        rest = ellipsoid((seat_width / 2 - 0.01, 0.1, 0.24), (0, 0, 0), cloth, color, 20, 0.45).rotated("x", 0.22)
        parts.append(rest.moved((x, back + 0.25, seat_height + 0.2)))
    arm_height = rng.uniform(0.56, 0.66)
    for side in (-1, 1):
        x = side * (inner + arm) / 2
        parts.append(
            box((arm * 0.85, depth - 0.12, arm_height - 0.18), (x, 0.03, 0.1 + (arm_height - 0.18) / 2), cloth, color)
        )
        roll = tube([[x, -depth / 2 + 0.1, 0], [x, depth / 2 - 0.02, 0]], arm / 2, cloth, color, 14).scaled((1, 1, 0.9))
        parts.append(roll.moved((0, 0, arm_height - arm * 0.45)))
    feet = [[a * (width / 2 - 0.1), b * (depth / 2 - 0.12), 0.05] for a in (-1, 1) for b in (-1, 1)]
    parts.append(boxes((0.06, 0.06, 0.1), feet, pick(rng, ("wood", "chrome")), color))
    for _ in range(int(rng.integers(0, 3))):
        x = rng.uniform(-inner / 2 + 0.2, inner / 2 - 0.2)
        pillow = ellipsoid((0.2, 0.07, 0.2), (0, 0, 0), "patterned_fabric", tint(rng), 16, 0.5)
        parts.append(pillow.rotated("x", 0.35).rotated("z", rng.uniform(-0.3, 0.3)).moved((x, 0.02, seat_height + 0.2)))
    return built(parts, Top((0.0, 0.12), (inner * 0.9, depth * 0.4), seat_height + 0.02))


def cushion(rng: Rng) -> Built:
    """A square cushion, lying."""
    side = rng.uniform(0.36, 0.5)
    height = rng.uniform(0.1, 0.16)
    body = ellipsoid(
        (side / 2, side / 2, height / 2),
        (0, 0, height / 2),
        pick(rng, ("fabric", "patterned_fabric")),
        tint(rng),
        20,
        0.5,
    )
    return built([body, sphere(0.012, (0, 0, height), "plastic", tint(rng), 8)])
