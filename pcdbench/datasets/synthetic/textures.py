"""Procedural textures: albedo from where a point lies, how its surface faces and the tint of its object."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcdbench.datasets.synthetic.noise import Floats, fractal_noise, hashed, uniform, value_noise

Palette = Sequence[tuple[float, float, float]]


@dataclass(frozen=True, eq=False)
class Surface:
    """N points on surfaces of one material.

    Attributes:
        points: (N, 3) metres, z up.
        uv: (N, 2) metres on the surface: (x, y) where it lies flat, else (along the wall, z).
        flat: (N,) whether the normal is nearest to the z axis.
        tints: (N,) int64 seeds of the objects.
    """

    points: Floats
    uv: Floats
    flat: NDArray[np.bool_]
    tints: NDArray[np.int64]

    @staticmethod
    def of(points: Floats, normals: Floats, tints: NDArray[np.int64]) -> Surface:
        """The surface coordinates of points with the given normals (N, 3)."""
        size = np.abs(normals)
        flat = size[:, 2] >= np.maximum(size[:, 0], size[:, 1]) - 1e-6
        along = np.where(flat | (size[:, 1] >= size[:, 0] - 1e-6), points[:, 0], points[:, 1])
        uv = np.column_stack([along, np.where(flat, points[:, 1], points[:, 2])])
        return Surface(points, uv, flat, tints)


Texture = Callable[[Surface], Floats]


def base_color(surface: Surface, palette: Palette, salt: int = 0, jitter: float = 0.08) -> Floats:
    """(N, 3) the palette's color that each object's tint chooses, a little lighter or darker by the tint."""
    choice = (hashed(surface.tints, salt) % np.uint64(len(palette))).astype(np.int64)
    light = 1.0 + jitter * (2.0 * uniform(surface.tints, salt, 1) - 1.0)
    return np.asarray(palette, np.float64)[choice] * light[:, None]


def tint_share(surface: Surface, salt: int) -> Floats:
    """(N,) a number in [0, 1) that each object's tint decides."""
    return uniform(surface.tints, salt)


def shaded(color: Floats, factor: Floats) -> Floats:
    """(N, 3) each color times its factor."""
    return color * factor[:, None]


def blended(first: Floats, second: Floats | tuple[float, float, float], share: Floats | NDArray[np.bool_]) -> Floats:
    """(N, 3) `first` where `share` is 0, `second` where it is 1."""
    weight = np.asarray(share, np.float64)[:, None]
    return first * (1.0 - weight) + np.asarray(second, np.float64) * weight


def plain(palette: Palette, unevenness: float = 0.06, grain_m: float = 0.08, jitter: float = 0.08) -> Texture:
    """One color an object with slight clouds: plastics, paints, metals."""

    def texture(surface: Surface) -> Floats:
        clouds = fractal_noise(surface.points / grain_m, surface.tints, 11, octaves=2)
        return shaded(base_color(surface, palette, 0, jitter), 1.0 + unevenness * (2.0 * clouds - 1.0))

    return texture


def wall_paint(palette: Palette) -> Texture:
    """Paint with unevenness at arm's length, scuffs above the floor, on some walls a darker base or a stripe."""

    def texture(surface: Surface) -> Floats:
        color = base_color(surface, palette, 0, 0.05)
        u, v = surface.uv.T
        style = tint_share(surface, 21)
        height = 0.9 + 0.4 * tint_share(surface, 22)
        second = base_color(surface, ((0.35, 0.45, 0.55), (0.55, 0.35, 0.28), (0.45, 0.52, 0.38), (0.7, 0.62, 0.4)), 23)
        upright = ~surface.flat
        band = (style < 0.12) & (v < height)
        band |= (style > 0.9) & (np.abs(v - height) < 0.09)
        color = blended(color, second, band & upright)
        clouds = fractal_noise(surface.uv / 0.9, surface.tints, 24, octaves=4)
        scuffs = value_noise(np.column_stack([u / 0.35, v / 0.04]), surface.tints, 25)
        scuffed = upright & (scuffs > 0.78) & (v < 0.22 + 0.25 * value_noise(surface.uv / 0.5, 26))
        return shaded(color, 1.0 + 0.12 * (clouds - 0.5) - 0.16 * scuffed)

    return texture


def wallpaper(palette: Palette) -> Texture:
    """Stripes, lozenges or dots, by the tint."""

    def texture(surface: Surface) -> Floats:
        color = base_color(surface, palette)
        style = tint_share(surface, 31)
        pitch = 0.09 + 0.16 * tint_share(surface, 32)
        u, v = (surface.uv / pitch[:, None]).T
        stripes = (u - np.floor(u)) < 0.42
        lozenges = np.abs(u - np.floor(u) - 0.5) + np.abs(v - np.floor(v) - 0.5) < 0.34
        shift = 0.5 * (np.floor(v) % 2)
        dots = np.hypot(u + shift - np.floor(u + shift) - 0.5, v - np.floor(v) - 0.5) < 0.27
        pattern = np.where(style < 0.35, stripes, np.where(style < 0.7, lozenges, dots))
        strength = 0.62 + 0.2 * tint_share(surface, 33)
        return shaded(color, np.where(pattern, strength, 1.0) * (0.97 + 0.06 * value_noise(surface.points / 0.6, 34)))

    return texture


def bricks(
    palette: Palette,
    length_m: float,
    height_m: float,
    joint_m: float,
    mortar: tuple[float, float, float],
) -> Texture:
    """Running bond: every brick of its own color, joints between."""

    def texture(surface: Surface) -> Floats:
        row = np.floor(surface.uv[:, 1] / height_m)
        along = surface.uv[:, 0] / length_m + 0.5 * (row % 2)
        brick = np.floor(along)
        share = uniform(surface.tints, brick, row, 41)
        color = shaded(base_color(surface, palette), 0.72 + 0.5 * share)
        color = shaded(color, 0.9 + 0.2 * fractal_noise(surface.uv / 0.03, 42, octaves=2))
        joint = ((along - brick) * length_m < joint_m) | (surface.uv[:, 1] - row * height_m < joint_m)
        return blended(color, mortar, joint)

    return texture


def tiles(palette: Palette, size_m: float, grout_m: float, grout: tuple[float, float, float]) -> Texture:
    """Square tiles with grout: one color, checkered, or sprinkled with a second color, by the tint."""

    def texture(surface: Surface) -> Floats:
        scaled = surface.uv / size_m
        cell = np.floor(scaled)
        column, row = cell.T
        style = tint_share(surface, 51)
        second = base_color(surface, palette, 52)
        checker = (style < 0.25) & ((column + row) % 2 == 1)
        sprinkled = (style > 0.75) & (uniform(surface.tints, column, row, 53) < 0.2)
        color = blended(base_color(surface, palette), second * 0.8, checker | sprinkled)
        color = shaded(color, 0.92 + 0.14 * uniform(surface.tints, column, row, 54))
        color = shaded(color, 0.94 + 0.12 * fractal_noise(surface.uv / 0.12, surface.tints, 55))
        within = (scaled - cell) * size_m
        return blended(color, grout, np.min(within, axis=1) < grout_m)

    return texture


def wood(palette: Palette, contrast: float = 0.3) -> Texture:
    """Grain that runs along the longer way of furniture: streaks of 1 to 5 cm, drawn out and a little wavy."""

    def texture(surface: Surface) -> Floats:
        u, v = surface.uv.T
        wave = 0.05 * value_noise(surface.uv / 0.5, surface.tints, 61)
        along = np.where(surface.flat, u, v)
        across = np.where(surface.flat, v, u) + wave
        streaks = fractal_noise(np.column_stack([along / 0.9, across / 0.045]), surface.tints, 62, octaves=3)
        return shaded(base_color(surface, palette), 1.0 + contrast * (2.0 * streaks - 1.0))

    return texture


def planks(palette: Palette, length_m: float, width_m: float, herringbone: bool = False) -> Texture:
    """Floor boards or parquet: every board of its own tone and grain, with dark joints."""

    def texture(surface: Surface) -> Floats:
        u, v = surface.uv.T
        if herringbone:
            block_u, block_v = np.floor(u / length_m), np.floor(v / length_m)
            turned = (block_u + block_v) % 2 == 1
            u, v = np.where(turned, v, u), np.where(turned, u, v)
        row = np.floor(v / width_m)
        shifted = u / length_m + (0.0 if herringbone else uniform(surface.tints, row, 71))
        board = np.floor(shifted)
        tone = uniform(surface.tints, board, row, 72)
        grain = fractal_noise(np.column_stack([u / 0.6, v / 0.03]), surface.tints, row, 73)
        color = shaded(base_color(surface, palette), (0.78 + 0.4 * tone) * (0.85 + 0.3 * grain))
        joint = (v - row * width_m < 0.004) | ((shifted - board) * length_m < 0.004)
        return shaded(color, np.where(joint, 0.55, 1.0))

    return texture


def carpet(palette: Palette) -> Texture:
    """Loop carpet: mottled, in squares of 50 cm, striped or with large blots, by the tint."""

    def texture(surface: Surface) -> Floats:
        first, second = base_color(surface, palette), base_color(surface, palette, 81)
        style = tint_share(surface, 82)
        cell = np.floor(surface.uv / 0.5)
        square = uniform(surface.tints, cell[:, 0], cell[:, 1], 83)
        stripes = value_noise(surface.uv[:, :1] / 0.12, surface.tints, 84) > 0.55
        blots = fractal_noise(surface.uv / 0.6, surface.tints, 85) > 0.55
        color = blended(first, second, (style >= 0.3) & (style < 0.6) & (square < 0.35))
        color = blended(
            color, blended(first, second, np.full(len(first), 0.6)), (style >= 0.6) & (style < 0.8) & stripes
        )
        color = blended(color, blended(first, second, np.full(len(first), 0.7)), (style >= 0.8) & blots)
        mottle = fractal_noise(surface.uv / 0.07, surface.tints, 86, octaves=2)
        pile = value_noise(surface.uv / 0.006, 87)
        return shaded(color, 0.78 + 0.24 * mottle + 0.14 * pile + 0.08 * (square - 0.5))

    return texture


def rug(palette: Palette) -> Texture:
    """A woven rug: rows of lozenges and bands in three colors."""

    def texture(surface: Surface) -> Floats:
        pitch = 0.16 + 0.12 * tint_share(surface, 91)
        u, v = (surface.uv / pitch[:, None]).T
        rings = np.floor((np.abs(u - np.floor(u) - 0.5) + np.abs(v - np.floor(v) - 0.5)) * 5.0)
        band = uniform(surface.tints, np.floor(v), 92) < 0.35
        color = blended(base_color(surface, palette), base_color(surface, palette, 93), (rings % 2 == 1) & ~band)
        color = blended(color, base_color(surface, palette, 94), (rings == 2) | (band & (np.floor(u * 4) % 2 == 0)))
        return shaded(color, 0.82 + 0.3 * value_noise(surface.uv / 0.01, 95))

    return texture


def marble(palette: Palette, vein: tuple[float, float, float]) -> Texture:
    """Stone with veins where folded noise is near its crease."""

    def texture(surface: Surface) -> Floats:
        drift = fractal_noise(surface.points / 0.5, surface.tints, 101)[:, None]
        folded = np.abs(fractal_noise(surface.points / 0.35 + 2.0 * drift, surface.tints, 102, octaves=4) - 0.5)
        return blended(base_color(surface, palette), vein, np.clip(1.0 - folded / 0.05, 0.0, 1.0) * 0.7)

    return texture


def speckles(palette: Palette, chips: Palette, size_m: float, share: float) -> Texture:
    """Terrazzo, granite, linoleum, soil: chips of other colors sprinkled over clouds."""

    def texture(surface: Surface) -> Floats:
        cell = np.floor(surface.points / size_m + 0.6 * value_noise(surface.points / size_m, 111)[:, None])
        random = uniform(surface.tints, cell[:, 0], cell[:, 1], cell[:, 2], 112)
        chip = np.asarray(chips)[np.minimum((random / share * len(chips)).astype(np.int64), len(chips) - 1)]
        clouds = fractal_noise(surface.points / 0.4, surface.tints, 113)
        return blended(shaded(base_color(surface, palette), 0.9 + 0.2 * clouds), chip, random < share)

    return texture


def concrete(palette: Palette) -> Texture:
    """Cast concrete: clouds, pores, and the joints and tie holes of its formwork on walls."""

    def texture(surface: Surface) -> Floats:
        clouds = fractal_noise(surface.uv / 0.7, surface.tints, 121, octaves=4)
        pores = value_noise(surface.uv / 0.012, 122) > 0.88
        panel = surface.uv / np.array([1.25, 2.5])
        within = (panel - np.floor(panel)) * np.array([1.25, 2.5])
        joint = np.min(within, axis=1) < 0.012
        hole = np.hypot(np.abs(within[:, 0] - 0.625) - 0.35, (within[:, 1] % 1.25) - 0.4) < 0.02
        return shaded(base_color(surface, palette), 0.82 + 0.36 * clouds - 0.12 * pores - 0.18 * joint - 0.4 * hole)

    return texture


def ceiling_panels(palette: Palette) -> Texture:
    """Mineral fibre panels of 60 cm in a T-bar grid, perforated or fissured by the tint."""

    def texture(surface: Surface) -> Floats:
        cell = np.floor(surface.uv / 0.6)
        within = surface.uv - cell * 0.6
        stained = uniform(surface.tints, cell[:, 0], cell[:, 1], 131) < 0.03
        stain = stained & (fractal_noise(surface.uv / 0.3, surface.tints, 132) > 0.55)
        holes = np.hypot(*((surface.uv / 0.03 - np.floor(surface.uv / 0.03) - 0.5).T)) < 0.2
        fissures = value_noise(surface.uv / np.array([0.05, 0.012]), 133) > 0.8
        marks = np.where(tint_share(surface, 134) < 0.5, holes, fissures)
        tone = 0.96 + 0.06 * uniform(surface.tints, cell[:, 0], cell[:, 1], 135)
        color = shaded(base_color(surface, palette, 0, 0.04), tone - 0.22 * marks)
        color = blended(color, (0.66, 0.56, 0.4), stain)
        return blended(color, (0.62, 0.63, 0.64), np.min(within, axis=1) < 0.024)

    return texture


def brushed(palette: Palette) -> Texture:
    """Metal brushed along one way."""

    def texture(surface: Surface) -> Floats:
        fine = value_noise(surface.uv / np.array([0.3, 0.003]), surface.tints, 141)
        broad = fractal_noise(surface.uv / np.array([0.8, 0.15]), surface.tints, 142, octaves=2)
        return shaded(base_color(surface, palette), 0.78 + 0.14 * fine + 0.3 * broad)

    return texture
