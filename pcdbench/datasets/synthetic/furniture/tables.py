"""Tables: desks, meeting tables, counters to stand at."""

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
    round_rectangle,
    tint,
)
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.primitives import (
    box,
    boxes,
    cylinder,
    frustum,
    lathe,
    prism,
    profile_prism,
    rounded_box,
    tube,
)

_TOPS = ("wood", "wood", "wood", "board")
_FRAMES = ("painted_metal", "black_metal", "brushed_steel", "colored_metal")


def drawer_unit(
    size: tuple[float, float, float], center: tuple[float, float], drawers: int, material: str, color: int
) -> Mesh:
    """A carcass on the floor with drawer fronts towards -y, a gap and a handle each."""
    width, depth, height = size
    x, y = center
    face = (height - 0.02) / drawers
    levels = 0.01 + face * (np.arange(drawers) + 0.5)
    column = np.ones(drawers)
    front = y - depth / 2
    return Mesh.merge(
        [
            box((width, depth, height), (x, y, height / 2), material, color),
            boxes(
                (width - 0.012, 0.02, face - 0.012),
                np.column_stack([x * column, (front - 0.01) * column, levels]),
                material,
                color,
            ),
            boxes(
                (min(0.16, width * 0.5), 0.025, 0.014),
                np.column_stack([x * column, (front - 0.035) * column, levels + face * 0.25]),
                "black_metal",
            ),
        ]
    )


def _legs(rng: Rng, width: float, depth: float, height: float, kind: str) -> list[Mesh]:
    color = tint(rng)
    frame = pick(rng, _FRAMES)
    x, y = width / 2 - 0.06, depth / 2 - 0.06
    if kind == "panel":
        board = pick(rng, ("wood", "board"))
        return [
            boxes((0.03, depth - 0.04, height), [[x + 0.03, 0, height / 2], [-x - 0.03, 0, height / 2]], board, color),
            box((width - 0.06, 0.02, height * 0.55), (0, y - 0.02, height * 0.66), board, color),
        ]
    if kind == "frame":
        feet = [[sx * x, sy * y, height / 2] for sx in (-1, 1) for sy in (-1, 1)]
        return [
            boxes((0.05, 0.05, height), feet, frame, color),
            boxes((2 * x, 0.03, 0.06), [[0, y, height - 0.03], [0, -y, height - 0.03]], frame, color),
            boxes((0.03, 2 * y, 0.06), [[x, 0, height - 0.03], [-x, 0, height - 0.03]], frame, color),
        ]
    if kind == "column":
        sides = np.array([-1.0, 1.0])
        place = np.column_stack([sides * (x - 0.08), [0.02, 0.02], [height / 2] * 2])
        return [
            boxes((0.08, 0.06, height), place, frame, color),
            *(rounded_box((0.09, depth - 0.06, 0.035), (p[0], 0, 0.0175), 0.015, frame, color) for p in place),
            box((2 * x - 0.16, 0.06, 0.04), (0, 0.02, height - 0.03), frame, color),
        ]
    wide, close = np.array([x, y]) + 0.03, np.array([x, y]) - 0.03
    legs = pick(rng, ("wood", frame))
    return [
        leaning_leg((a * wide[0], b * wide[1]), (a * close[0], b * close[1]), height, (0.018, 0.03), legs, color)
        for a in (-1, 1)
        for b in (-1, 1)
    ]


def desk(rng: Rng) -> Built:
    """A desk whose user sits at +y; with or without drawers, some L-shaped."""
    width, depth = rng.uniform(1.2, 1.8), rng.uniform(0.65, 0.85)
    height, thick = rng.uniform(0.71, 0.76), rng.uniform(0.022, 0.04)
    material, color = pick(rng, _TOPS), tint(rng)
    under = height - thick
    kind = pick(rng, ("panel", "frame", "column", "splayed"))
    parts = _legs(rng, width, depth, under, kind)
    tops = [Top((0.0, 0.0), (width - 0.06, depth - 0.06), height)]
    if chance(rng, 0.25):
        wing_width, wing_depth = rng.uniform(0.5, 0.65), rng.uniform(0.6, 0.9)
        left, front = -width / 2, -depth / 2
        outline = [
            (left, -front),
            (left, front - wing_depth),
            (left + wing_width, front - wing_depth),
            (left + wing_width, front - 0.15),
            (left + wing_width + 0.15, front),
            (-left, front),
            (-left, -front),
        ]
        parts.append(prism(outline, under, height, material, color))
        feet = [
            [left + wing_width - 0.06, front - wing_depth + 0.06, under / 2],
            [left + 0.06, front - wing_depth + 0.06, under / 2],
        ]
        parts.append(boxes((0.05, 0.05, under), feet, "painted_metal", color))
        tops.append(Top((left + wing_width / 2, front - wing_depth / 2), (wing_width - 0.08, wing_depth - 0.1), height))
    else:
        parts.append(rounded_box((width, depth, thick), (0, 0, under + thick / 2), 0.008, material, color))
    if chance(rng, 0.65):
        own = pick(rng, ("wood", "board", "painted_metal"))
        tall = rng.uniform(0.5, 0.6)
        place = (width / 2 - 0.3, 0.02)
        unit = drawer_unit((0.42, depth * 0.8, tall), place, int(rng.integers(2, 5)), own, tint(rng))
        parts.append(unit)
    mesh = Mesh.merge(parts)
    low, high = mesh.bounds()
    middle = (low + high) / 2 * [1, 1, 0]
    turned = [Top((middle[0] - top.center[0], middle[1] - top.center[1]), top.size, top.z) for top in tops]
    return Built(mesh.moved(-middle).rotated("z", np.pi), tuple(turned))


def round_table(rng: Rng) -> Built:
    """A round table on a tulip foot, a column with a cross, or splayed legs."""
    radius, height = rng.uniform(0.4, 0.75), rng.uniform(0.71, 0.76)
    color, base_tint = tint(rng), tint(rng)
    material = pick(rng, ("wood", "board", "marble", "wood"))
    profile = [(0, height - 0.035), (radius - 0.03, height - 0.035), (radius, height - 0.015), (radius, height)]
    parts = [lathe([*profile, (0, height)], material, color, segments=32)]
    kind = pick(rng, ("tulip", "cross", "legs"))
    metal = pick(rng, ("painted_metal", "black_metal", "brushed_steel", "white_plastic"))
    if kind == "tulip":
        foot = radius * 0.62
        curve = [(0, 0), (foot, 0), (foot, 0.015), (foot * 0.5, 0.05), (0.06, 0.16), (0.04, 0.35), (0.055, 0.6)]
        parts.append(lathe([*curve, (0.16, height - 0.035), (0, height - 0.035)], metal, base_tint))
    elif kind == "cross":
        parts.append(cylinder(0.045, height - 0.06, (0, 0, 0.03), metal, base_tint, 12))
        for turn in (0.0, np.pi / 2):
            parts.append(
                rounded_box((radius * 1.4, 0.07, 0.04), (0, 0, 0.02), 0.015, metal, base_tint).rotated("z", turn)
            )
    else:
        reach = radius * 0.7
        for a, b in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            outer, inner = (a * reach, b * reach), (a * reach * 0.7, b * reach * 0.7)
            parts.append(leaning_leg(outer, inner, height - 0.03, (0.018, 0.028), "wood", base_tint))
    side = radius * 1.3
    return built(parts, Top((0.0, 0.0), (side, side), height))


def meeting_table(rng: Rng) -> Built:
    """A long table for meetings: oval, boat-shaped or with round corners, on two pedestals."""
    length, depth = rng.uniform(2.0, 3.6), rng.uniform(1.0, 1.35)
    height = rng.uniform(0.72, 0.76)
    material, color = pick(rng, ("wood", "wood", "board", "marble")), tint(rng)
    kind = pick(rng, ("oval", "boat", "round corners"))
    if kind == "oval":
        angle = 2 * np.pi * np.arange(36) / 36
        power = 0.75
        x = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** power * length / 2
        outline = np.column_stack([x, np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** power * depth / 2])
    elif kind == "boat":
        x = np.linspace(-length / 2, length / 2, 13)
        y = depth / 2 * (1 - 0.28 * (2 * x / length) ** 2)
        outline = np.concatenate([np.column_stack([x, -y]), np.column_stack([x[::-1], y[::-1]])])
    else:
        outline = round_rectangle(length, depth, 0.18)
    parts = [prism(outline, height - 0.04, height, material, color)]
    foot_tint, foot = tint(rng), pick(rng, ("painted_metal", "wood", "black_metal"))
    wide = chance(rng, 0.5)
    for side in (-1, 1):
        x0 = side * length * 0.28
        if wide:
            parts.append(box((0.1, depth * 0.55, height - 0.04), (x0, 0, (height - 0.04) / 2), foot, foot_tint))
        else:
            parts.append(frustum(0.26, 0.09, 0.06, (x0, 0, 0), foot, foot_tint))
            parts.append(cylinder(0.09, height - 0.1, (x0, 0, 0.06), foot, foot_tint, 16))
    parts.append(box((0.4, 0.14, 0.012), (0, 0, height + 0.006), "brushed_steel", color))
    return built(parts, Top((0.0, 0.0), (length * 0.8, depth * 0.72), height))


def dining_table(rng: Rng) -> Built:
    """A rectangular table on four legs: canteens, kitchens, class rooms."""
    width, depth, height = rng.uniform(1.1, 1.9), rng.uniform(0.7, 0.95), rng.uniform(0.72, 0.77)
    material, color = pick(rng, ("wood", "board", "wood")), tint(rng)
    parts = [rounded_box((width, depth, 0.03), (0, 0, height - 0.015), 0.01, material, color)]
    parts += _legs(rng, width, depth, height - 0.03, pick(rng, ("frame", "splayed")))
    return built(parts, Top((0.0, 0.0), (width - 0.08, depth - 0.08), height))


def coffee_table(rng: Rng) -> Built:
    """A low table with a shelf under its top, rectangular or round."""
    height = rng.uniform(0.36, 0.46)
    color = tint(rng)
    material = pick(rng, ("wood", "marble", "board", "wood"))
    if chance(rng, 0.4):
        radius = rng.uniform(0.35, 0.5)
        parts = [cylinder(radius, 0.03, (0, 0, height - 0.03), material, color, 28)]
        for k in range(3):
            angle = 2 * np.pi * k / 3
            x, y = radius * np.cos(angle), radius * np.sin(angle)
            parts.append(
                leaning_leg((x * 0.92, y * 0.92), (x * 0.6, y * 0.6), height - 0.03, (0.016, 0.016), "black_metal")
            )
        return built(parts, Top((0.0, 0.0), (radius * 1.3, radius * 1.3), height))
    width, depth = rng.uniform(0.8, 1.2), rng.uniform(0.5, 0.65)
    x, y = width / 2 - 0.04, depth / 2 - 0.04
    parts = [
        rounded_box((width, depth, 0.035), (0, 0, height - 0.0175), 0.01, material, color),
        box((width - 0.1, depth - 0.1, 0.02), (0, 0, 0.13), material, color),
        boxes(
            (0.045, 0.045, height - 0.03),
            [[a * x, b * y, (height - 0.03) / 2] for a in (-1, 1) for b in (-1, 1)],
            "wood",
            color,
        ),
    ]
    return built(parts, Top((0.0, 0.0), (width - 0.06, depth - 0.06), height))


def reception_counter(rng: Rng) -> Built:
    """A counter bent around whoever sits behind it: a panelled front, a high shelf, a lower desk."""
    radius, angle = rng.uniform(1.3, 2.0), rng.uniform(0.6, 1.0)
    height = rng.uniform(1.05, 1.15)
    front, top = pick(rng, ("wood_panelling", "board", "wood", "brick")), pick(rng, ("wood", "stone_counter", "marble"))
    a, b, color = np.pi / 2 - angle, np.pi / 2 + angle, tint(rng)
    desk_height = 0.74
    parts = [
        prism(arc_band(radius, 0.06, a, b, 14), 0.08, height - 0.04, front, color),
        prism(arc_band(radius + 0.01, 0.03, a, b, 14), 0.0, 0.08, "black_metal", color),
        prism(arc_band(radius - 0.2, 0.36, a - 0.03, b + 0.03, 14), height - 0.04, height, top, tint(rng)),
        prism(arc_band(radius - 0.62, 0.62, a, b, 14), desk_height - 0.035, desk_height, "board", tint(rng)),
    ]
    for end in (a + 0.02, b - 0.02):
        direction = np.array([np.cos(end), np.sin(end)])
        middle = direction * (radius - 0.29)
        panel = box((0.58, 0.03, desk_height - 0.035), (0, 0, (desk_height - 0.035) / 2), front, color)
        parts.append(panel.moved((middle[0], middle[1], 0.0), end))
    mesh = Mesh.merge(parts)
    low, high = mesh.bounds()
    shift = -(low[1] + high[1]) / 2
    tops = (
        Top((0.0, radius - 0.04 + shift), (0.5, 0.24), height),
        Top((0.0, radius - 0.38 + shift), (radius * 0.5, 0.3), desk_height),
    )
    return Built(mesh.moved((0, shift, 0)), tops)


def podium(rng: Rng) -> Built:
    """A lectern with a slanted top and a microphone on a gooseneck."""
    width, height, color = rng.uniform(0.5, 0.7), rng.uniform(1.0, 1.15), tint(rng)
    material = pick(rng, ("wood", "board", "wood"))
    side = [(-0.17, 0.0), (0.17, 0.0), (0.2, height), (-0.2, height - 0.14)]
    body = profile_prism(side, -width / 2, width / 2, material, color)
    top = rounded_box((width + 0.1, 0.5, 0.03), (0, 0, 0), 0.01, material, color).rotated("x", 0.34)
    neck = [[0.15, 0.15, height], [0.15, 0.16, height + 0.2], [0.15, 0.12, height + 0.3], [0.15, 0.05, height + 0.33]]
    parts = [
        box((width + 0.06, 0.44, 0.05), (0, 0, 0.025), material, color),
        body,
        top.moved((0, 0, height - 0.05)),
        tube(neck, [0.006, 0.006, 0.006, 0.014], "black_metal", segments=6),
        box((0.22, 0.012, 0.22), (0, 0.2, height * 0.6), "sign_blue", color),
    ]
    return built(parts)
