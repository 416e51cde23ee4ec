"""What things are kept in: shelves, cabinets, lockers, racks."""

from __future__ import annotations

import numpy as np

from pcdbench.datasets.synthetic.furniture.piece import Built, Rng, Top, built, chance, pick, tint, tints
from pcdbench.datasets.synthetic.furniture.tables import drawer_unit
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.primitives import box, boxes, cylinder, lathe, rounded_box, sphere

_CARCASS = ("wood", "board", "wood", "board")


def books_row(rng: Rng, width: float, height: float, depth: float) -> Mesh:
    """Upright books from x = 0 to at most `width`, spines at y = 0 towards +y, standing on z = 0."""
    count = max(1, int(width / 0.026))
    thick = rng.uniform(0.014, 0.052, count)
    ends = np.cumsum(thick)
    keep = ends < width
    thick, ends = thick[keep], ends[keep]
    tall = height * rng.uniform(0.68, 0.95, len(thick))
    deep = depth * rng.uniform(0.7, 0.98, len(thick))
    sizes = np.column_stack([thick * 0.96, deep, tall])
    centers = np.column_stack([ends - thick / 2, -deep / 2 - rng.uniform(0, 0.02, len(thick)), tall / 2])
    return boxes(sizes, centers, "book_cover", tints(rng, len(thick)))


def binders_row(rng: Rng, width: float, height: float, depth: float) -> Mesh:
    """Lever arch files side by side, as `books_row`."""
    count = max(1, int(width / 0.085))
    tall, deep = min(0.31, height * 0.95), min(0.28, depth * 0.95)
    centers = np.column_stack([0.0425 + 0.085 * np.arange(count), np.full(count, -deep / 2), np.full(count, tall / 2)])
    backs = centers * [1, 0, 1] + [0, 0.001, 0.02]
    colors = np.repeat(tints(rng, 3), count)[:count]
    return Mesh.merge(
        [
            boxes((0.08, deep, tall), centers, "plastic", colors),
            boxes((0.05, 0.004, tall * 0.45), backs, "paper", colors),
        ]
    )


def _filling(rng: Rng, width: float, height: float, depth: float) -> list[Mesh]:
    """What stands on one shelf, from x = 0 to `width`, front at y = 0."""
    kind = rng.random()
    if kind < 0.5:
        return [books_row(rng, width * rng.uniform(0.65, 1.0), min(height, 0.34), depth)]
    if kind < 0.68:
        return [binders_row(rng, width * rng.uniform(0.5, 0.98), height, depth)]
    if kind < 0.8:
        count = max(1, int(width / 0.36))
        tall = min(0.26, height * 0.85)
        spots = np.column_stack([0.18 + 0.36 * np.arange(count), np.full(count, -depth / 2), np.full(count, tall / 2)])
        return [
            boxes((0.31, depth * 0.9, tall), spots, pick(rng, ("cardboard", "wicker", "plastic")), tints(rng, count))
        ]
    if kind < 0.93:
        things = [books_row(rng, width * 0.45, min(height, 0.3), depth)]
        x = width * rng.uniform(0.6, 0.85)
        size = min(0.11, height * 0.3)
        if chance(rng, 0.5):
            profile = [
                (0, 0),
                (size * 0.6, 0),
                (size, size),
                (size * 0.4, size * 2),
                (size * 0.5, size * 2.4),
                (0, size * 2.4),
            ]
            things.append(lathe(profile, "ceramic", tint(rng), (x, -depth / 2, 0), 14))
        else:
            things.append(sphere(size, (x, -depth / 2, size), "glazed_pattern", tint(rng), 14))
        return things
    return []


def bookcase(rng: Rng) -> Built:
    """A bookcase, low or tall, full of books, files, boxes and odd things."""
    width, depth = rng.uniform(0.75, 1.3), rng.uniform(0.26, 0.38)
    shelves = int(rng.integers(2, 7))
    pitch = rng.uniform(0.3, 0.38)
    height = shelves * pitch + 0.1
    material, color, thick = pick(rng, _CARCASS), tint(rng), 0.022
    levels = 0.08 + pitch * np.arange(shelves)
    bays = 2 if width > 1.0 else 1
    uprights = np.linspace(-width / 2 + thick / 2, width / 2 - thick / 2, bays + 1)
    parts = [
        boxes((thick, depth, height), [[x, 0, height / 2] for x in uprights], material, color),
        boxes((width - thick, depth - 0.01, thick), [[0, 0, z - thick / 2] for z in levels], material, color),
        box((width, depth, thick), (0, 0, height - thick / 2), material, color),
        box((width - 0.01, 0.008, height - 0.02), (0, -depth / 2 + 0.006, height / 2), material, color),
        box((width, 0.02, 0.06), (0, depth / 2 - 0.04, 0.03), material, color),
    ]
    inner = (width - thick) / bays - thick
    for x in uprights[:-1] + thick / 2:
        for level in levels:
            for thing in _filling(rng, inner, pitch - thick - 0.02, depth - 0.04):
                parts.append(thing.moved((x, depth / 2 - 0.02, level)))
    tops = [Top((0.0, 0.0), (width - 0.06, depth - 0.06), height)] if height < 1.5 else []
    return built(parts, *tops)


def open_rack(rng: Rng) -> Built:
    """Steel shelving: perforated posts, boards, boxes and crates."""
    width, depth, height = rng.uniform(0.9, 1.5), rng.uniform(0.38, 0.6), rng.uniform(1.7, 2.1)
    shelves, metal, color = (
        int(rng.integers(4, 6)),
        pick(rng, ("painted_metal", "galvanized", "colored_metal")),
        tint(rng),
    )
    x, y = width / 2 - 0.02, depth / 2 - 0.02
    levels = np.linspace(0.12, height - 0.1, shelves)
    parts = [
        boxes((0.04, 0.04, height), [[a * x, b * y, height / 2] for a in (-1, 1) for b in (-1, 1)], metal, color),
        boxes((width, depth, 0.03), [[0, 0, z] for z in levels], metal, color),
    ]
    for level in levels[:-1]:
        at = -width / 2 + 0.05
        while at < width / 2 - 0.3:
            size = (rng.uniform(0.22, 0.42), depth * rng.uniform(0.6, 0.9), rng.uniform(0.14, 0.32))
            if at + size[0] > width / 2 - 0.04:
                break
            if chance(rng, 0.8):
                material = pick(rng, ("cardboard", "cardboard", "plastic", "book_spines"))
                parts.append(box(size, (at + size[0] / 2, 0, level + 0.015 + size[2] / 2), material, tint(rng)))
            at += size[0] + rng.uniform(0.02, 0.1)
    return built(parts)


def _doors(width: float, depth: float, z0: float, z1: float, doors: int, material: str, color: int) -> Mesh:
    """Door leaves with gaps and upright handles on the +y side."""
    leaf = width / doors
    x = -width / 2 + leaf * (np.arange(doors) + 0.5)
    ones = np.ones(doors)
    side = np.where(np.arange(doors) % 2 == 0, 1, -1) if doors > 1 else ones
    handle = np.column_stack([x + side * (leaf / 2 - 0.045), (depth / 2 + 0.035) * ones, ((z0 + z1) / 2) * ones])
    return Mesh.merge(
        [
            boxes(
                (leaf - 0.012, 0.02, z1 - z0 - 0.012),
                np.column_stack([x, (depth / 2 + 0.008) * ones, (z0 + z1) / 2 * ones]),
                material,
                color,
            ),
            boxes((0.014, 0.025, min(0.18, (z1 - z0) * 0.4)), handle, "brushed_steel"),
        ]
    )


def cabinet(rng: Rng) -> Built:
    """A cabinet with doors, low (a sideboard), at hip height or tall."""
    height = pick(rng, (0.75, 0.85, 1.15, 1.8, 1.95)) * rng.uniform(0.95, 1.05)
    width, depth = rng.uniform(0.8, 1.0) * (1.6 if height < 0.9 else 1.0), rng.uniform(0.38, 0.46)
    material, color = pick(rng, ("wood", "board", "painted_metal", "wood")), tint(rng)
    doors = 2 if width < 1.1 else int(rng.integers(3, 5))
    door_tint = color if chance(rng, 0.7) else tint(rng)
    parts = [
        box((width - 0.04, depth - 0.05, 0.08), (0, 0, 0.04), "black_metal"),
        box((width, depth, height - 0.1), (0, 0, 0.08 + (height - 0.1) / 2), material, color),
        box((width + 0.02, depth + 0.03, 0.02), (0, 0, height - 0.01), material, color),
    ]
    if height > 1.7 and chance(rng, 0.4):
        parts.append(_doors(width, depth, 0.1, height * 0.48, doors, material, door_tint))
        parts.append(_doors(width, depth, height * 0.5, height - 0.03, doors, material, door_tint))
    else:
        parts.append(_doors(width, depth, 0.1, height - 0.03, doors, material, door_tint))
    tops = [Top((0.0, 0.0), (width - 0.06, depth - 0.06), height)] if height < 1.4 else []
    return built(parts, *tops)


def filing_cabinet(rng: Rng) -> Built:
    """A steel cabinet of two to four drawers."""
    drawers = int(rng.integers(2, 5))
    width, depth, height = rng.uniform(0.4, 0.5), rng.uniform(0.5, 0.62), 0.33 * drawers + 0.04
    unit = drawer_unit((width, depth, height), (0.0, 0.0), drawers, "painted_metal", tint(rng)).rotated("z", np.pi)
    labels = [[0, depth / 2 + 0.021, 0.01 + (height - 0.02) / drawers * (k + 0.5)] for k in range(drawers)]
    top = Top((0.0, 0.0), (width - 0.06, depth - 0.06), height)
    return built([unit, boxes((0.09, 0.004, 0.04), labels, "paper", tint(rng))], top)


def lockers(rng: Rng) -> Built:
    """A row of steel lockers with vents."""
    columns, rows = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    width, depth, height = columns * rng.uniform(0.3, 0.38), rng.uniform(0.42, 0.5), rng.uniform(1.75, 1.9)
    color = tint(rng)
    x = -width / 2 + width / columns * (np.arange(columns) + 0.5)
    z = 0.1 + (height - 0.12) / rows * (np.arange(rows) + 0.5)
    place = np.array([[a, depth / 2 + 0.008, c] for a in x for c in z])
    leaf = (width / columns - 0.014, 0.02, (height - 0.12) / rows - 0.014)
    vents = [np.add(place, (0, 0.011, leaf[2] * 0.5 - 0.06 - 0.03 * k)) for k in range(3)]
    parts = [
        box((width, depth, height - 0.08), (0, 0, 0.08 + (height - 0.08) / 2), "painted_metal", color),
        box((width - 0.02, depth - 0.04, 0.08), (0, 0, 0.04), "black_metal"),
        boxes(leaf, place, "colored_metal", color if chance(rng, 0.5) else np.repeat(tints(rng, columns), rows)),
        boxes((leaf[0] * 0.55, 0.004, 0.01), np.concatenate(vents), "black_metal"),
        boxes((0.02, 0.03, 0.06), np.add(place, (leaf[0] * 0.38, 0.015, 0)), "brushed_steel"),
    ]
    return built(parts)


def wardrobe(rng: Rng) -> Built:
    """A wardrobe with doors above drawers or down to the floor, one of them perhaps a mirror."""
    width, depth, height = rng.uniform(1.0, 1.8), rng.uniform(0.55, 0.62), rng.uniform(1.95, 2.2)
    material, color, doors = pick(rng, ("wood", "board", "wood")), tint(rng), int(rng.integers(2, 4))
    low = 0.45 if chance(rng, 0.4) else 0.08
    parts = [
        box((width, depth, height - 0.06), (0, 0, 0.06 + (height - 0.06) / 2), material, color),
        box((width - 0.03, depth - 0.04, 0.06), (0, 0, 0.03), material, color),
        box((width + 0.05, depth + 0.06, 0.05), (0, 0, height), material, color),
        _doors(width, depth, low, height - 0.04, doors, material, color),
    ]
    if low > 0.1:
        parts.append(
            boxes(
                (width / 2 - 0.02, 0.02, 0.34),
                [[a * width / 4, depth / 2 + 0.008, 0.26] for a in (-1, 1)],
                material,
                color,
            )
        )
        parts.append(
            boxes((0.16, 0.025, 0.015), [[a * width / 4, depth / 2 + 0.03, 0.3] for a in (-1, 1)], "brushed_steel")
        )
    if chance(rng, 0.3):
        leaf = width / doors
        parts.append(
            box(
                (leaf - 0.12, 0.006, height - low - 0.25),
                (-width / 2 + leaf / 2, depth / 2 + 0.021, (height + low) / 2),
                "mirror",
            )
        )
    return built(parts)


def wall_shelf(rng: Rng) -> Built:
    """A board on brackets at the wall, with books and pots on it."""
    width, depth, height = rng.uniform(0.7, 1.4), rng.uniform(0.2, 0.28), rng.uniform(1.3, 1.7)
    parts = [
        box((width, depth, 0.025), (0, depth / 2, height - 0.0125), pick(rng, ("wood", "board")), tint(rng)),
        boxes(
            (0.02, depth - 0.04, 0.04),
            [[s * width * 0.35, depth / 2 - 0.02, height - 0.045] for s in (-1, 1)],
            "black_metal",
        ),
    ]
    things = _filling(rng, width - 0.06, 0.3, depth - 0.045)
    return built([*parts, *(thing.moved((-width / 2 + 0.03, depth - 0.02, height)) for thing in things)])


def box_stack(rng: Rng) -> Built:
    """Packing boxes piled on the floor, a little turned against each other; one may be open."""
    parts: list[Mesh] = []
    for column in range(int(rng.integers(1, 3))):
        z = 0.0
        for _ in range(int(rng.integers(1, 4))):
            size = (rng.uniform(0.32, 0.55), rng.uniform(0.28, 0.42), rng.uniform(0.2, 0.38))
            crate = box(size, (0, 0, size[2] / 2), "cardboard", tint(rng))
            parts.append(crate.moved((column * 0.58 - 0.2, rng.uniform(-0.04, 0.04), z), rng.uniform(-0.3, 0.3)))
            z += size[2]
        if chance(rng, 0.5):
            flap = box((size[0], 0.16, 0.008), (0, 0, 0), "cardboard", tint(rng)).rotated("x", 0.7)
            parts.append(flap.moved((column * 0.58 - 0.2, size[1] / 2 + 0.04, z + 0.02)))
    return built(parts)


def crate(rng: Rng) -> Built:
    """An open plastic crate or basket with things in it."""
    width, depth, height = rng.uniform(0.36, 0.55), rng.uniform(0.28, 0.38), rng.uniform(0.2, 0.3)
    material, color = pick(rng, ("plastic", "wicker")), tint(rng)
    parts = [
        box((width, depth, 0.015), (0, 0, 0.0075), material, color),
        boxes((width, 0.015, height), [[0, s * (depth / 2 - 0.0075), height / 2] for s in (-1, 1)], material, color),
        boxes((0.015, depth, height), [[s * (width / 2 - 0.0075), 0, height / 2] for s in (-1, 1)], material, color),
    ]
    for _ in range(int(rng.integers(2, 6))):
        spot = (rng.uniform(-0.3, 0.3) * width, rng.uniform(-0.3, 0.3) * depth, height * rng.uniform(0.3, 0.9))
        kind = pick(rng, ("ball", "box", "roll"))
        if kind == "ball":
            parts.append(sphere(0.06, spot, "plastic", tint(rng), 12))
        elif kind == "box":
            parts.append(rounded_box((0.14, 0.09, 0.12), spot, 0.01, "cardboard", tint(rng)))
        else:
            parts.append(cylinder(0.03, 0.25, spot, "paper", tint(rng), 10))
    return built(parts)
