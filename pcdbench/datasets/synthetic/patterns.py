"""Textures of things rather than of building materials: cloth, prints, screens, books, plants."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pcdbench.datasets.synthetic.noise import Floats, fractal_noise, uniform, value_noise
from pcdbench.datasets.synthetic.textures import Palette, Surface, Texture, base_color, blended, shaded, tint_share

BRIGHT: Palette = (
    (0.8, 0.16, 0.14), (0.15, 0.32, 0.65), (0.93, 0.75, 0.18), (0.16, 0.5, 0.3), (0.9, 0.88, 0.82),
    (0.12, 0.12, 0.14), (0.88, 0.45, 0.15), (0.45, 0.22, 0.5), (0.3, 0.62, 0.72), (0.55, 0.33, 0.2),
)  # fmt: skip


def bright_color(*cells: ArrayLike) -> Floats:
    """(N, 3) a printer's color decided by integers."""
    share = uniform(*cells)
    return np.asarray(BRIGHT)[(share * len(BRIGHT)).astype(np.int64)]


def fabric(palette: Palette, patterned: bool = False) -> Texture:
    """Woven cloth: melange, and where patterned checks, stripes or blots by the tint."""

    def texture(surface: Surface) -> Floats:
        color = base_color(surface, palette)
        if patterned:
            second = base_color(surface, palette, 201)
            style = tint_share(surface, 202)
            pitch = 0.05 + 0.08 * tint_share(surface, 203)
            u, v = (surface.uv / pitch[:, None]).T
            odd_u, odd_v = np.floor(u) % 2 == 1, np.floor(v) % 2 == 1
            checks = 0.5 * odd_u + 0.5 * odd_v
            blots = 1.0 * (fractal_noise(surface.points / 0.12, surface.tints, 204) > 0.52)
            color = blended(color, second, np.where(style < 0.4, checks, np.where(style < 0.7, odd_u, blots)))
        melange = value_noise(surface.points / 0.008, 205)
        wear = fractal_noise(surface.points / 0.25, surface.tints, 206)
        return shaded(color, 0.8 + 0.18 * melange + 0.22 * wear)

    return texture


def leather(palette: Palette) -> Texture:
    """Leather: creases and worn, lighter places."""

    def texture(surface: Surface) -> Floats:
        crease = np.abs(fractal_noise(surface.points / 0.06, surface.tints, 211) - 0.5) < 0.02
        wear = fractal_noise(surface.points / 0.3, surface.tints, 212)
        return shaded(base_color(surface, palette), 0.8 + 0.45 * wear - 0.18 * crease)

    return texture


def netting(palette: Palette) -> Texture:
    """Open mesh cloth of office chairs."""

    def texture(surface: Surface) -> Floats:
        cell = surface.uv / 0.012
        hole = np.hypot(*(cell - np.floor(cell) - 0.5).T) < 0.32
        return shaded(base_color(surface, palette), np.where(hole, 0.6, 1.0))

    return texture


def curtain(palette: Palette) -> Texture:
    """Curtain cloth: plain, with broad stripes or with large round motifs, darker towards the hem."""

    def texture(surface: Surface) -> Floats:
        color, second = base_color(surface, palette), base_color(surface, palette, 221)
        style = tint_share(surface, 222)
        u, v = surface.uv.T
        stripes = value_noise(surface.uv[:, :1] / 0.14, surface.tints, 223) > 0.55
        row = np.floor(v / 0.28)
        shifted = u / 0.28 + 0.5 * (row % 2)
        rings = np.floor(np.hypot(shifted - np.floor(shifted) - 0.5, v / 0.28 - row - 0.5) * 9.0)
        motif = (rings < 4) & (rings % 2 == 0)
        color = blended(color, second, np.where(style < 0.4, False, np.where(style < 0.7, stripes, motif)))
        return shaded(color, 0.85 + 0.2 * value_noise(surface.uv / 0.01, 224))

    return texture


def artwork(surface: Surface) -> Floats:
    """A painting or poster: discs, bars and fields of random colors, some 10 to 40 cm large."""
    tints = surface.tints
    pitch = 0.22 + 0.3 * tint_share(surface, 231)
    scaled = surface.uv / pitch[:, None]
    warp = fractal_noise(scaled, tints, 232) * 1.6 * (tint_share(surface, 233) < 0.5)
    field = np.floor(scaled + warp[:, None])
    color = bright_color(tints, field[:, 0], field[:, 1], 234)
    cell = np.floor(scaled)
    within = scaled - cell - 0.5
    offset = np.column_stack([uniform(tints, *cell.T, 235), uniform(tints, *cell.T, 236)]) * 0.3 - 0.15
    radius = 0.15 + 0.3 * uniform(tints, *cell.T, 237)
    disc = np.hypot(*(within - offset).T) < radius
    bar = (np.abs(within[:, 1] - offset[:, 1]) < 0.08) & (uniform(tints, *cell.T, 238) < 0.5)
    color = blended(color, bright_color(tints, *cell.T, 239), disc)
    color = blended(color, bright_color(tints, *cell.T, 240), bar)
    return shaded(color, 0.9 + 0.2 * fractal_noise(surface.uv / 0.03, tints, 241, octaves=2))


def photograph(surface: Surface) -> Floats:
    """A landscape at the height of pictures on walls: sky above hills above a foreground, in the tint's colors."""
    tints = surface.tints
    height = np.clip((surface.uv[:, 1] - 1.1) / 0.9 + 0.2 * tint_share(surface, 251), 0.0, 1.0)
    ridge = 0.55 + 0.3 * (fractal_noise(surface.uv[:, :1] / 0.2, tints, 252) - 0.5)
    shore = 0.25 + 0.2 * (fractal_noise(surface.uv[:, :1] / 0.12, tints, 253) - 0.5)
    sky = blended(
        base_color(surface, ((0.45, 0.65, 0.88), (0.92, 0.62, 0.35), (0.7, 0.75, 0.8)), 254), (0.95, 0.93, 0.9), height
    )
    hills = base_color(surface, ((0.2, 0.38, 0.22), (0.35, 0.3, 0.42), (0.5, 0.35, 0.2)), 255)
    near = base_color(surface, ((0.1, 0.2, 0.12), (0.75, 0.65, 0.45), (0.15, 0.25, 0.4)), 256)
    color = blended(blended(sky, hills, height < ridge), near, height < shore)
    return shaded(color, 0.85 + 0.3 * fractal_noise(surface.uv / 0.04, tints, 257))


def _written(surface: Surface, line_m: float, share: float, salt: int) -> Floats:
    """(N,) 1 where handwriting or print lies: lines of `line_m`, of which `share` are written on."""
    line = np.floor(surface.uv[:, 1] / line_m)
    height = surface.uv[:, 1] / line_m - line
    block = np.floor(surface.uv[:, 0] / (line_m * 12) + uniform(surface.tints, np.floor(line / 4), salt))
    used = uniform(surface.tints, block, np.floor(line / 4), salt, 1) < share
    letters = value_noise(
        np.column_stack([surface.uv[:, 0] / (line_m * 0.22), height * 2.5]), surface.tints, line, salt
    )
    words = value_noise(surface.uv[:, :1] / (line_m * 0.9), surface.tints, line, salt, 2) > 0.3
    return (used & words & (letters > 0.52) & (height > 0.25) & (height < 0.8)).astype(np.float64)


def whiteboard(surface: Surface) -> Floats:
    """A whiteboard: blocks of writing in three pens, drawn boxes, wiped smears."""
    tints = surface.tints
    smear = fractal_noise(surface.uv / np.array([0.4, 0.15]), tints, 261)
    color = shaded(np.tile([0.93, 0.94, 0.95], (len(tints), 1)), 0.93 + 0.1 * smear)
    cell = np.floor(surface.uv / np.array([0.6, 0.24]))
    pen = uniform(tints, *cell.T, 262)
    ink = np.where(
        pen[:, None] < 0.45, [0.12, 0.2, 0.6], np.where(pen[:, None] < 0.75, [0.1, 0.1, 0.12], [0.75, 0.1, 0.12])
    )
    color = blended(color, ink, _written(surface, 0.06, 0.55, 263))
    box = np.floor(surface.uv / 0.45)
    drawn = uniform(tints, *box.T, 264) < 0.3
    edge = np.abs(np.max(np.abs(surface.uv / 0.45 - box - 0.5), axis=1) - 0.4) < 0.02
    return blended(color, ink, drawn & edge)


def notices(palette: Palette) -> Texture:
    """A pin board: sheets of paper in several sizes and colors over its ground."""

    def texture(surface: Surface) -> Floats:
        tints = surface.tints
        color = shaded(base_color(surface, palette), 0.8 + 0.4 * value_noise(surface.uv / 0.01, 271))
        for layer, size in enumerate((0.34, 0.24)):
            cell = np.floor(surface.uv / size)
            offset = np.column_stack([uniform(tints, *cell.T, 272, layer), uniform(tints, *cell.T, 273, layer)])
            within = np.abs(surface.uv / size - cell - 0.42 - 0.16 * offset)
            extent = np.column_stack([0.2 + 0.18 * offset[:, 0], 0.25 + 0.15 * offset[:, 1]])
            sheet = np.all(within < extent, axis=1) & (uniform(tints, *cell.T, 274, layer) < 0.6)
            white = uniform(tints, *cell.T, 275, layer) < 0.6
            page = np.where(white[:, None], [0.93, 0.93, 0.9], bright_color(tints, *cell.T, 276 + layer))
            color = blended(color, page, sheet)
            color = shaded(color, 1.0 - 0.6 * sheet * _written(surface, 0.02, 0.8, 278))
        return color

    return texture


def paper(surface: Surface) -> Floats:
    """Printed paper."""
    ground = np.tile([0.93, 0.93, 0.91], (len(surface.tints), 1))
    return shaded(ground, 1.0 - 0.45 * _written(surface, 0.018, 0.75, 281))


def book_spines(surface: Surface) -> Floats:
    """A row of spines: stripes of random widths and colors with title bands; on top, pages."""
    u, v = surface.uv.T
    cell = np.floor(u / 0.032 + 0.8 * value_noise(surface.uv[:, :1] / 0.032, surface.tints, 291))
    shelf = np.floor(v / 0.35)
    color = shaded(bright_color(surface.tints, cell, shelf, 292), 0.65 + 0.5 * uniform(surface.tints, cell, shelf, 293))
    middle = (0.3 + 0.4 * uniform(surface.tints, cell, shelf, 294)) * 0.35
    title = np.abs(v - shelf * 0.35 - middle) < 0.025
    color = blended(color, (0.9, 0.85, 0.7), title & (uniform(surface.tints, cell, shelf, 295) < 0.7))
    return blended(color, (0.88, 0.85, 0.76), surface.flat)


def book_cover(surface: Surface) -> Floats:
    """One book or folder: cloth or print in one color with a title band."""
    color = shaded(base_color(surface, BRIGHT, 301, 0.2), 0.85 + 0.25 * value_noise(surface.points / 0.02, 302))
    place = surface.uv[:, 1] / 0.11 + tint_share(surface, 303)
    band = (place - np.floor(place) < 0.2) & (tint_share(surface, 304) < 0.6)
    return blended(color, base_color(surface, BRIGHT, 305), band)


def screen(surface: Surface) -> Floats:
    """A display: dark, or lit with windows, a picture and lines of text."""
    tints = surface.tints
    cell = np.floor(surface.uv / np.array([0.3, 0.22]) + tint_share(surface, 311)[:, None])
    kind = uniform(tints, *cell.T, 312)
    window = np.where(kind[:, None] < 0.45, [0.9, 0.92, 0.94], [0.16, 0.19, 0.24])
    window = np.where(kind[:, None] > 0.8, bright_color(tints, *cell.T, 313), window)
    lines = _written(surface, 0.024, 0.6, 314)
    lit = np.where(lines[:, None] > 0, 0.5 * window + 0.2, window)
    return blended(lit, (0.035, 0.035, 0.045), tint_share(surface, 315) < 0.3)


def keys(palette: Palette) -> Texture:
    """A keyboard's keys, 19 mm apart."""

    def texture(surface: Surface) -> Floats:
        row = np.floor(surface.uv[:, 1] / 0.019)
        along = surface.uv[:, 0] / 0.019 + 0.25 * (row % 4)
        gap = (along - np.floor(along) < 0.2) | (surface.uv[:, 1] / 0.019 - row < 0.2)
        return shaded(base_color(surface, palette), np.where(gap, 0.45, 1.0))

    return texture


def goods(surface: Surface) -> Floats:
    """What a vending machine shows: rows of bottles and bags behind its window."""
    pitch = np.array([0.085, 0.26])
    cell = np.floor(surface.uv / pitch)
    within = surface.uv / pitch - cell
    wide = 0.3 + 0.12 * uniform(surface.tints, *cell.T, 321)
    tall = 0.55 + 0.3 * uniform(surface.tints, cell[:, 1], 322)
    item = (np.abs(within[:, 0] - 0.5) < wide) & (within[:, 1] > 0.1) & (within[:, 1] < tall)
    kind = np.floor(cell[:, 0] / 2)
    color = blended(
        np.tile([0.2, 0.21, 0.24], (len(cell), 1)), bright_color(surface.tints, kind, cell[:, 1], 323), item
    )
    label = item & (np.abs(within[:, 1] - 0.4) < 0.1)
    color = blended(color, bright_color(surface.tints, kind, cell[:, 1], 324), label)
    return blended(color, (0.85, 0.85, 0.86), within[:, 1] < 0.07)


def leaves(palette: Palette) -> Texture:
    """Leaves: every one of its own green, paler in patches."""

    def texture(surface: Surface) -> Floats:
        cell = np.floor(surface.points / 0.09)
        tone = 0.65 + 0.5 * uniform(surface.tints, *cell.T, 331)
        patch = fractal_noise(surface.points / 0.05, surface.tints, 332)
        return shaded(base_color(surface, palette), tone * (0.75 + 0.5 * patch))

    return texture


def slats(palette: Palette, pitch_m: float, gap: float, depth: float = 0.35, upright: bool = False) -> Texture:
    """Slats or slots: grilles, blinds, radiators; `gap` of each pitch is darkened to `depth`."""

    def texture(surface: Surface) -> Floats:
        place = surface.uv[:, 0 if upright else 1] / pitch_m
        return shaded(base_color(surface, palette), np.where(place - np.floor(place) < gap, depth, 1.0))

    return texture


def cardboard(surface: Surface) -> Floats:
    """Packing board with tape, prints and stains."""
    color = shaded(
        base_color(surface, ((0.68, 0.5, 0.32), (0.6, 0.44, 0.28), (0.74, 0.58, 0.4))),
        0.88 + 0.24 * fractal_noise(surface.points / 0.2, surface.tints, 341),
    )
    cell = np.floor(surface.uv / 0.16)
    label = uniform(surface.tints, *cell.T, 342)
    within = np.max(np.abs(surface.uv / 0.16 - cell - 0.5), axis=1)
    color = blended(color, (0.9, 0.9, 0.88), (label < 0.12) & (within < 0.35))
    return shaded(color, 1.0 - 0.5 * _written(surface, 0.03, 0.35, 343))


def signage(palette: Palette) -> Texture:
    """A sign: lines of white letters, among them a pictogram in a white square, on a strong color."""

    def texture(surface: Surface) -> Floats:
        color = base_color(surface, palette)
        column = np.floor(surface.uv[:, 0] / 0.2 + tint_share(surface, 351))
        pictured = uniform(surface.tints, column, 352) < 0.35
        within = np.abs(surface.uv / 0.2 + tint_share(surface, 351)[:, None] - 0.5)
        within = np.abs(within - np.round(within))
        square = np.max(within, axis=1) < 0.36
        wedge = within[:, 0] + within[:, 1] < 0.26
        letters = _written(surface, 0.055, 0.85, 353) > 0
        return blended(color, (0.95, 0.95, 0.93), np.where(pictured, square & ~wedge, letters))

    return texture
