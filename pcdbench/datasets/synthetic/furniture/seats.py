"""What people sit on."""

from __future__ import annotations

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import (
    Built,
    Rng,
    Top,
    arc_band,
    built,
    chance,
    leaning_leg,
    pick,
    tint,
)
from pcdbench.datasets.synthetic.mesh import Floats, Mesh
from pcdbench.datasets.synthetic.primitives import (
    box,
    boxes,
    cylinder,
    ellipsoid,
    frustum,
    grid_border,
    lathe,
    prism,
    profile_prism,
    rounded_box,
    surface,
    tube,
)

_CLOTH = ("fabric", "fabric", "leather", "patterned_fabric")


def bent_back(width: float, height: float, thickness: float, bend_m: float, material: str, color: int) -> Mesh:
    """A cushioned back from z = 0 up, its middle pushed `bend_m` to -y, with a lumbar bulge."""

    def displaced(vertices: Floats) -> Floats:
        x, z = vertices[:, 0] / (width / 2), vertices[:, 2] / height
        shift = -bend_m * (1 - x**2) - 0.12 * height * z + 0.05 * np.sin(np.pi * np.clip(z, 0, 1))
        narrowing = 1 - 0.16 * z**2
        return np.column_stack([vertices[:, 0] * narrowing, vertices[:, 1] + shift, vertices[:, 2]])

    columns, rows = 9, 8
    x = np.linspace(-width / 2, width / 2, columns)
    z = np.linspace(0.0, height, rows)
    round_off = np.sqrt(np.clip(1 - np.abs(2 * z / height - 1) ** 6, 0, 1))
    half = thickness / 2 * round_off[:, None] * np.sqrt(np.clip(1 - np.abs(2 * x / width) ** 6, 0, 1))[None, :]
    grid_x, grid_z = np.meshgrid(x, z)
    front, back = np.stack([grid_x, half, grid_z], -1)[:, ::-1], np.stack([grid_x, -half, grid_z], -1)
    return surface(np.concatenate([front, back], axis=1), material, color, closed=True).deformed(displaced)


def office_chair(rng: Rng) -> Built:
    """A swivel chair: five-star base on castors, gas spring, bent back, mostly with armrests."""
    seat_height, color = rng.uniform(0.44, 0.54), tint(rng)
    cloth = pick(rng, ("fabric", "leather", "fabric", "netting"))
    base = pick(rng, ("black_plastic", "chrome", "gray_plastic"))
    width, reach = rng.uniform(0.46, 0.52), rng.uniform(0.29, 0.34)
    parts: list[Mesh] = []
    start = rng.uniform(0, np.pi)
    for k in range(5):
        turn = start + 2 * np.pi * k / 5
        out = np.array([np.cos(turn), np.sin(turn)])
        parts.append(tube([[0, 0, 0.13], [*(out * reach), 0.085]], [0.03, 0.018], base, segments=6))
        wheel = ellipsoid((0.03, 0.022, 0.03), (0, 0, 0.03), "rubber", segments=10)
        parts.append(wheel.moved((*(out * reach), 0.0), turn + 1.0))
        parts.append(cylinder(0.01, 0.05, (*(out * reach), 0.045), base, segments=6))
    parts.append(cylinder(0.028, seat_height - 0.17, (0, 0, 0.1), base, segments=10))
    parts.append(box((0.2, 0.22, 0.04), (0, 0, seat_height - 0.06), "black_plastic"))
    seat = rounded_box((width, 0.48, 0.09), (0, 0.02, 0), 0.045, "fabric" if cloth == "netting" else cloth, color, 3)
    lowered = seat.deformed(lambda v: v - [0, 0, 0.5] * np.maximum(v[:, 1:2], 0) ** 3)
    parts.append(lowered.moved((0, 0, seat_height)))
    back_height = rng.uniform(0.5, 0.68)
    back = bent_back(width - 0.03, back_height, 0.05 if cloth == "netting" else 0.08, 0.06, cloth, color)
    parts.append(back.moved((0, -0.2, seat_height + 0.1)))
    spine = [
        [0, -0.05, seat_height - 0.06],
        [0, -0.24, seat_height - 0.04],
        [0, -0.32, seat_height + 0.15],
        [0, -0.34, seat_height + 0.4],
    ]
    parts.append(tube(spine, 0.022, "black_plastic", segments=6))
    if chance(rng, 0.75):
        for side in (-1, 1):
            x = side * (width / 2 + 0.03)
            path = [[side * 0.15, 0, seat_height - 0.06], [x, 0, seat_height - 0.03], [x, -0.02, seat_height + 0.18]]
            parts.append(tube(path, 0.016, base, segments=6))
            parts.append(rounded_box((0.07, 0.26, 0.03), (x, 0.03, seat_height + 0.2), 0.013, "black_plastic"))
    if chance(rng, 0.25):
        parts.append(rounded_box((0.26, 0.07, 0.15), (0, -0.33, seat_height + back_height + 0.16), 0.03, cloth, color))
    return built(parts)


def chair(rng: Rng) -> Built:
    """A chair for visitors: a wooden one with slats, a moulded shell, or a cushioned cantilever."""
    kind, color = pick(rng, ("wooden", "shell", "cantilever")), tint(rng)
    height = rng.uniform(0.43, 0.47)
    if kind == "wooden":
        x, y, back = 0.2, 0.2, rng.uniform(0.84, 0.98)
        parts = [
            rounded_box((0.44, 0.43, 0.03), (0, 0, height - 0.015), 0.012, "wood", color),
            boxes(
                (0.035, 0.035, height - 0.02), [[s * x, y - 0.02, (height - 0.02) / 2] for s in (-1, 1)], "wood", color
            ),
            boxes((0.36, 0.02, 0.05), [[0, y - 0.02, height - 0.06], [0, -y, height - 0.06]], "wood", color),
            boxes((0.02, 0.36, 0.03), [[s * x, 0, height * 0.4] for s in (-1, 1)], "wood", color),
        ]
        for side in (-1, 1):
            side_view = [(-y - 0.02, 0), (-y + 0.02, 0), (-y + 0.02, height)]
            side_view += [(-y - 0.06, back), (-y - 0.09, back), (-y - 0.02, height)]
            parts.append(profile_prism(side_view, side * x - 0.018, side * x + 0.018, "wood", color))
        slats = int(rng.integers(2, 5))
        for level in np.linspace(height + 0.14, back - 0.06, slats):
            lean = -y - 0.08 * (level - height) / (back - height)
            slat = arc_band(0.45, 0.018, -np.pi / 2 - 0.45, -np.pi / 2 + 0.45, 6)
            parts.append(prism(slat, level - 0.03, level + 0.04, "wood", color).moved((0, 0.43 + lean, 0)))
        if chance(rng, 0.4):
            parts.append(rounded_box((0.4, 0.39, 0.05), (0, 0.01, height + 0.02), 0.022, pick(rng, _CLOTH), tint(rng)))
        return built(parts, Top((0.0, 0.0), (0.3, 0.3), height))
    if kind == "shell":
        shell = _seat_shell(pick(rng, ("plastic", "wood", "plastic", "fabric")), color).moved((0, 0, height))
        legs, leg_tint = pick(rng, ("chrome", "wood", "black_metal")), tint(rng)
        parts = [shell]
        for sx in (-1, 1):
            for sy in (-1, 1):
                foot, top = (sx * 0.22, sy * 0.22), (sx * 0.13, sy * 0.13)
                parts.append(leaning_leg(foot, top, height - 0.01, (0.013, 0.013), legs, leg_tint))
        parts.append(boxes((0.28, 0.03, 0.02), [[0, s * 0.13, height - 0.02] for s in (-1, 1)], "black_metal"))
        return built(parts)
    cloth = pick(rng, _CLOTH)
    parts = [rounded_box((0.46, 0.46, 0.07), (0, 0.02, height), 0.03, cloth, color)]
    parts.append(bent_back(0.45, 0.42, 0.05, 0.03, cloth, color).moved((0, -0.2, height + 0.12)))
    metal = pick(rng, ("chrome", "black_metal"))
    for side in (-1, 1):
        x = side * 0.25
        path = [
            [x, -0.22, 0.0125],
            [x, 0.24, 0.0125],
            [x, 0.25, 0.06],
            [x, 0.23, height - 0.06],
            [x, 0.19, height - 0.01],
            [x, -0.17, height - 0.01],
            [x, -0.22, height + 0.05],
            [x, -0.28, height + 0.5],
        ]
        parts.append(tube(path, 0.0125, metal, segments=7))
        if chance(rng, 0.7):
            parts.append(rounded_box((0.045, 0.3, 0.025), (x, 0.0, height + 0.21), 0.01, "black_plastic"))
            parts.append(tube([[x, 0.14, height - 0.01], [x, 0.14, height + 0.2]], 0.0125, metal, segments=6))
    parts.append(tube([[-0.25, -0.22, 0.0125], [0.25, -0.22, 0.0125]], 0.0125, metal, segments=7))
    return built(parts)


def _seat_shell(material: str, color: int) -> Mesh:
    """A moulded seat and back in one: a strip bent up behind, raised at its sides; seat at z = 0."""
    along = np.array(
        [
            [0.24, -0.03],
            [0.2, 0.0],
            [0.05, -0.01],
            [-0.12, -0.01],
            [-0.19, 0.03],
            [-0.225, 0.12],
            [-0.25, 0.26],
            [-0.27, 0.38],
            [-0.275, 0.42],
        ]
    )
    half = np.array([0.2, 0.23, 0.235, 0.235, 0.23, 0.225, 0.22, 0.19, 0.14])
    across = np.linspace(-1, 1, 9)
    lift = 0.045 * np.abs(across) ** 3
    tangent = np.gradient(along, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = -normal
    x = half[:, None] * across[None, :]
    y = along[:, :1] + normal[:, :1] * lift
    z = along[:, 1:] + normal[:, 1:] * lift
    upper = np.stack([x, y, z], -1)
    lower = upper - 0.012 * np.stack([0 * half, normal[:, 0], normal[:, 1]], -1)[:, None, :]
    return Mesh.merge(
        [
            surface(upper[::-1], material, color),
            surface(lower, material, color),
            surface(np.stack([grid_border(upper), grid_border(lower)]), material, color, closed=True),
        ]
    )


def stool(rng: Rng) -> Built:
    """A bar stool, a wooden stool or a drum-shaped pouf."""
    kind, color = pick(rng, ("bar", "wooden", "pouf")), tint(rng)
    if kind == "pouf":
        radius, height = rng.uniform(0.2, 0.28), rng.uniform(0.38, 0.46)
        bulge = [(0, 0), (radius - 0.02, 0), (radius + 0.01, height * 0.3), (radius + 0.01, height * 0.7)]
        return built([lathe([*bulge, (radius - 0.03, height - 0.02), (0, height)], pick(rng, _CLOTH), color)])
    height = rng.uniform(0.62, 0.78) if kind == "bar" else rng.uniform(0.44, 0.48)
    if kind == "bar":
        metal = pick(rng, ("chrome", "black_metal"))
        ring = np.column_stack(
            [
                0.16 * np.cos(np.linspace(0, 2 * np.pi, 17)[:-1]),
                0.16 * np.sin(np.linspace(0, 2 * np.pi, 17)[:-1]),
                np.full(16, 0.27),
            ]
        )
        parts = [
            lathe(
                [
                    (0, 0),
                    (0.21, 0),
                    (0.2, 0.015),
                    (0.06, 0.04),
                    (0.03, 0.08),
                    (0.028, height - 0.06),
                    (0, height - 0.06),
                ],
                metal,
                color,
            ),
            tube(ring, 0.01, metal, color, segments=6, closed=True),
            tube([[0, 0, 0.27], [0, 0.16, 0.27]], 0.01, metal, color, segments=6),
            lathe(
                [(0, height - 0.07), (0.17, height - 0.06), (0.19, height - 0.03), (0.17, height), (0, height)],
                pick(rng, _CLOTH),
                color,
            ),
        ]
        return built(parts)
    parts = [frustum(0.17, 0.18, 0.035, (0, 0, height - 0.035), "wood", color)]
    for k in range(4):
        angle = np.pi / 4 + k * np.pi / 2
        x, y = np.cos(angle), np.sin(angle)
        parts.append(
            leaning_leg((x * 0.19, y * 0.19), (x * 0.12, y * 0.12), height - 0.03, (0.014, 0.018), "wood", color)
        )
    return built(parts, Top((0.0, 0.0), (0.2, 0.2), height))


def bench(rng: Rng) -> Built:
    """A bench of slats on two frames, or a row of joined seats as in waiting rooms."""
    width, color = rng.uniform(1.2, 1.9), tint(rng)
    metal = pick(rng, ("black_metal", "painted_metal", "brushed_steel"))
    if chance(rng, 0.5):
        height = rng.uniform(0.43, 0.48)
        slats = [[0, y, height - 0.02] for y in np.linspace(-0.17, 0.17, 4)]
        parts = [boxes((width, 0.095, 0.04), slats, "wood", color)]
        for side in (-1, 1):
            x = side * (width / 2 - 0.2)
            parts.append(
                boxes((0.05, 0.04, height - 0.04), [[x, s * 0.17, (height - 0.04) / 2] for s in (-1, 1)], metal, color)
            )
            parts.append(box((0.05, 0.38, 0.04), (x, 0, height - 0.06), metal, color))
        return built(parts, Top((0.0, 0.0), (width - 0.1, 0.3), height))
    seats = max(2, round(width / 0.55))
    parts = [box((seats * 0.55, 0.06, 0.06), (0, 0, 0.36), metal, color)]
    material = pick(rng, ("plastic", "netting", "wood"))
    for k in range(seats):
        parts.append(_seat_shell(material, color).moved(((k - (seats - 1) / 2) * 0.55, 0.02, 0.41)))
    for side in (-1, 1):
        x = side * (seats - 1) / 2 * 0.55
        parts.append(box((0.06, 0.06, 0.34), (x, 0, 0.18), metal, color))
        parts.append(rounded_box((0.06, 0.5, 0.04), (x, 0, 0.02), 0.015, metal, color))
    return built(parts)
