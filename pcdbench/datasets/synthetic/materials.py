"""The materials of rooms and furniture: their texture, and what a laser scanner gets back from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcdbench.datasets.synthetic import patterns, textures
from pcdbench.datasets.synthetic.textures import Palette, Surface, Texture

ScanReturn = Literal["diffuse", "transparent", "mirror"]

WHITES: Palette = ((0.92, 0.92, 0.9), (0.9, 0.88, 0.82), (0.86, 0.88, 0.88), (0.94, 0.92, 0.86))
WALLS: Palette = (
    (0.9, 0.89, 0.86), (0.88, 0.84, 0.74), (0.8, 0.85, 0.86), (0.84, 0.86, 0.78), (0.9, 0.82, 0.74),
    (0.74, 0.78, 0.83), (0.93, 0.92, 0.9), (0.78, 0.72, 0.66), (0.62, 0.68, 0.62), (0.86, 0.8, 0.82),
)  # fmt: skip
WOODS: Palette = (
    (0.72, 0.55, 0.36), (0.6, 0.42, 0.26), (0.45, 0.29, 0.17), (0.82, 0.68, 0.48), (0.33, 0.21, 0.13),
    (0.66, 0.46, 0.32), (0.76, 0.62, 0.46),
)  # fmt: skip
BOARDS: Palette = (
    (0.9, 0.9, 0.88), (0.75, 0.76, 0.77), (0.55, 0.57, 0.6), (0.86, 0.8, 0.7), (0.3, 0.32, 0.35),
    (0.32, 0.45, 0.55), (0.7, 0.32, 0.22), (0.42, 0.52, 0.36),
)  # fmt: skip
CLOTHS: Palette = (
    (0.25, 0.32, 0.45), (0.5, 0.18, 0.18), (0.32, 0.38, 0.28), (0.45, 0.45, 0.47), (0.66, 0.6, 0.5),
    (0.16, 0.17, 0.19), (0.72, 0.48, 0.2), (0.25, 0.48, 0.5), (0.55, 0.42, 0.5), (0.78, 0.74, 0.68),
)  # fmt: skip
FLOOR_CLOTHS: Palette = (
    (0.35, 0.38, 0.44), (0.42, 0.4, 0.38), (0.28, 0.34, 0.42), (0.48, 0.3, 0.28), (0.5, 0.47, 0.42),
    (0.3, 0.38, 0.34), (0.22, 0.24, 0.28), (0.58, 0.5, 0.4),
)  # fmt: skip
STONES: Palette = ((0.82, 0.8, 0.76), (0.62, 0.62, 0.62), (0.72, 0.62, 0.52), (0.4, 0.4, 0.42), (0.86, 0.84, 0.8))
METALS: Palette = ((0.62, 0.63, 0.65), (0.7, 0.7, 0.7), (0.55, 0.56, 0.58))
PAINTED: Palette = ((0.75, 0.76, 0.76), (0.28, 0.3, 0.32), (0.6, 0.62, 0.62), (0.3, 0.42, 0.55), (0.82, 0.8, 0.74))
PLASTICS: Palette = (*patterns.BRIGHT, (0.6, 0.62, 0.64), (0.85, 0.85, 0.84))
BLACKS: Palette = ((0.06, 0.06, 0.065), (0.1, 0.1, 0.11), (0.14, 0.14, 0.15))
GREENS: Palette = ((0.16, 0.38, 0.14), (0.24, 0.45, 0.18), (0.12, 0.3, 0.16), (0.36, 0.48, 0.2))


@dataclass(frozen=True)
class Material:
    """What a surface is made of.

    Attributes:
        name: what meshes call it.
        texture: its albedo.
        scan: `diffuse` returns the ray; `transparent` lets it through; `mirror` returns nothing.
        dropout: the probability that a ray that hits returns nothing (dark gloss, polished metal).
        glow: light given off, added to any shade, in [0, 1] (lamps, lit screens).
    """

    name: str
    texture: Texture
    scan: ScanReturn = "diffuse"
    dropout: float = 0.0
    glow: float = 0.0

    @property
    def transparent(self) -> bool:
        """Whether rays pass."""
        return self.scan == "transparent"

    @property
    def mirror(self) -> bool:
        """Whether rays are thrown elsewhere, so that none returns."""
        return self.scan == "mirror"


MATERIALS: tuple[Material, ...] = (
    # walls
    Material("wall_paint", textures.wall_paint(WALLS)),
    Material("plaster", textures.concrete(WHITES)),
    Material("wallpaper", textures.wallpaper(WALLS)),
    Material(
        "brick",
        textures.bricks(
            ((0.6, 0.3, 0.22), (0.68, 0.42, 0.3), (0.82, 0.8, 0.76), (0.5, 0.28, 0.24)),
            0.24,
            0.075,
            0.011,
            (0.72, 0.7, 0.66),
        ),
    ),
    Material("concrete", textures.concrete(STONES)),
    Material("wall_tiles", textures.tiles(WALLS, 0.15, 0.005, (0.6, 0.6, 0.6))),
    Material("wood_panelling", textures.planks(WOODS, 2.4, 0.11)),
    Material("baseboard", textures.plain((*WHITES, (0.5, 0.36, 0.24), (0.2, 0.2, 0.22)))),
    # floors
    Material("floor_tiles", textures.tiles(STONES, 0.4, 0.008, (0.45, 0.44, 0.42))),
    Material("small_floor_tiles", textures.tiles((*STONES, (0.55, 0.3, 0.22)), 0.2, 0.006, (0.4, 0.4, 0.4))),
    Material("parquet", textures.planks(WOODS, 0.45, 0.075, herringbone=True)),
    Material("planks", textures.planks(WOODS, 1.3, 0.14)),
    Material("carpet", textures.carpet(FLOOR_CLOTHS)),
    Material("rug", textures.rug(CLOTHS)),
    Material(
        "linoleum",
        textures.speckles((*FLOOR_CLOTHS[:5], (0.6, 0.66, 0.6)), ((0.8, 0.8, 0.78), (0.25, 0.25, 0.27)), 0.03, 0.14),
    ),
    Material(
        "terrazzo",
        textures.speckles(
            STONES, ((0.3, 0.3, 0.32), (0.75, 0.5, 0.4), (0.92, 0.9, 0.86), (0.4, 0.46, 0.42)), 0.025, 0.4
        ),
    ),
    Material("marble", textures.marble(((0.88, 0.87, 0.85), (0.3, 0.32, 0.3), (0.82, 0.74, 0.64)), (0.5, 0.47, 0.44))),
    # ceilings
    Material("ceiling_panels", textures.ceiling_panels(((0.9, 0.9, 0.88), (0.86, 0.86, 0.84)))),
    Material("ceiling_paint", textures.plain(WHITES, 0.05, 0.9)),
    # openings
    Material("glass", textures.plain(((0.7, 0.78, 0.78),)), scan="transparent"),
    Material("mirror", textures.plain(((0.75, 0.78, 0.8),)), scan="mirror"),
    Material("door_wood", textures.wood((*WOODS, (0.85, 0.84, 0.8)), 0.22)),
    Material("door_paint", textures.plain((*BOARDS, *WHITES), 0.05, 0.6)),
    Material("blinds", patterns.slats((*WHITES, (0.6, 0.62, 0.64), (0.7, 0.6, 0.45)), 0.05, 0.3, 0.6)),
    Material("curtain", patterns.curtain((*CLOTHS, (0.85, 0.82, 0.75), (0.78, 0.76, 0.72)))),
    # furniture
    Material("wood", textures.wood(WOODS)),
    Material("board", textures.plain(BOARDS, 0.04, 0.5)),
    Material("stone_counter", textures.speckles(STONES, ((0.2, 0.2, 0.22), (0.9, 0.9, 0.88)), 0.012, 0.3)),
    Material("fabric", patterns.fabric(CLOTHS)),
    Material("patterned_fabric", patterns.fabric(CLOTHS, patterned=True)),
    Material(
        "leather", patterns.leather(((0.12, 0.1, 0.09), (0.4, 0.22, 0.13), (0.55, 0.36, 0.22), (0.75, 0.68, 0.58)))
    ),
    Material("netting", patterns.netting(((0.12, 0.12, 0.13), (0.3, 0.32, 0.34), (0.2, 0.28, 0.4)))),
    Material("painted_metal", textures.plain(PAINTED, 0.05, 0.3)),
    Material("colored_metal", textures.plain((*PLASTICS, *PAINTED), 0.05, 0.3)),
    Material("brushed_steel", textures.brushed(METALS), dropout=0.15),
    Material("chrome", textures.brushed(((0.78, 0.79, 0.8),)), dropout=0.4),
    Material("black_metal", textures.plain(BLACKS), dropout=0.1),
    Material("plastic", textures.plain(PLASTICS)),
    Material("white_plastic", textures.plain(WHITES, 0.04)),
    Material("gray_plastic", textures.plain(((0.45, 0.46, 0.47), (0.3, 0.31, 0.32), (0.62, 0.62, 0.6)))),
    Material("black_plastic", textures.plain(BLACKS, 0.15), dropout=0.05),
    Material("black_gloss", textures.plain(((0.03, 0.03, 0.035),)), dropout=0.5),
    Material("rubber", textures.plain(((0.08, 0.08, 0.08), (0.16, 0.16, 0.16)), 0.15)),
    Material("ceramic", textures.plain(((0.94, 0.94, 0.92), *patterns.BRIGHT), 0.04)),
    Material("glazed_pattern", patterns.curtain((*WHITES, *patterns.BRIGHT))),
    Material(
        "terracotta",
        textures.plain(((0.66, 0.36, 0.24), (0.6, 0.58, 0.55), (0.2, 0.2, 0.21), (0.86, 0.85, 0.82)), 0.15),
    ),
    Material(
        "wicker",
        textures.bricks(
            ((0.6, 0.44, 0.26), (0.45, 0.32, 0.2), (0.72, 0.6, 0.42)), 0.036, 0.014, 0.004, (0.26, 0.18, 0.11)
        ),
    ),
    Material("red_gloss", textures.plain(((0.72, 0.06, 0.05),))),
    # things
    Material("screen", patterns.screen, dropout=0.2, glow=0.5),
    Material("keyboard", patterns.keys((*BLACKS, (0.85, 0.85, 0.83), (0.7, 0.71, 0.72)))),
    Material("paper", patterns.paper),
    Material("book_spines", patterns.book_spines),
    Material("book_cover", patterns.book_cover),
    Material("pages", textures.plain(((0.9, 0.87, 0.78), (0.93, 0.92, 0.88)), 0.05, 0.01)),
    Material("cardboard", patterns.cardboard),
    Material("artwork", patterns.artwork),
    Material("photograph", patterns.photograph),
    Material("whiteboard", patterns.whiteboard, dropout=0.1),
    Material("notices", patterns.notices(((0.7, 0.52, 0.34), (0.3, 0.4, 0.55), (0.35, 0.42, 0.36)))),
    Material("goods", patterns.goods, glow=0.3),
    Material("leaves", patterns.leaves(GREENS)),
    Material("bark", textures.wood(((0.36, 0.26, 0.18), (0.46, 0.38, 0.3)), 0.5)),
    Material("soil", textures.speckles(((0.2, 0.14, 0.1),), ((0.34, 0.26, 0.2), (0.1, 0.08, 0.06)), 0.012, 0.4)),
    Material("clear_plastic", textures.plain(((0.55, 0.72, 0.82), (0.7, 0.76, 0.76)), 0.1), dropout=0.5),
    # building services
    Material("lamp", textures.plain(((0.97, 0.96, 0.92), (0.98, 0.93, 0.82)), 0.02), glow=0.7),
    Material("lampshade", patterns.fabric(((0.92, 0.88, 0.78), (0.85, 0.7, 0.5), (0.75, 0.75, 0.75))), glow=0.25),
    Material("grille", patterns.slats(((0.86, 0.86, 0.85), (0.7, 0.71, 0.72)), 0.03, 0.45)),
    Material("galvanized", textures.brushed(((0.66, 0.68, 0.7),)), dropout=0.1),
    Material("radiator", textures.plain(WHITES, 0.05, 0.4)),
    Material("sign_green", patterns.signage(((0.05, 0.5, 0.28),)), glow=0.3),
    Material("sign_blue", patterns.signage(((0.1, 0.28, 0.6), (0.75, 0.12, 0.1), (0.2, 0.2, 0.22)))),
)

_PIECE = 8192  # points at a time: their arrays stay in the cache, which halves the time
_IDS = {material.name: index for index, material in enumerate(MATERIALS)}


def material_id(name: str) -> int:
    """The index of a material in `MATERIALS`.

    Raises:
        KeyError: there is no material of that name.
    """
    return _IDS[name]


def colors(points: ArrayLike, normals: ArrayLike, material_ids: ArrayLike, tints: ArrayLike) -> NDArray[np.float32]:
    """The albedo of points on surfaces.

    Args:
        points: (N, 3) metres in the frame the textures are fixed to (the room's, or the object's).
        normals: (N, 3) of any length, in the same frame.
        material_ids: (N,) indices into `MATERIALS`.
        tints: (N,) integers.

    Returns:
        (N, 3) float32 in [0, 1]; the same on every machine.
    """
    at, facing = np.asarray(points, np.float64), np.asarray(normals, np.float64)
    kinds, seeds = np.asarray(material_ids), np.asarray(tints, np.int64)
    albedo = np.zeros((len(at), 3), np.float32)
    for kind in np.unique(kinds):
        members = np.flatnonzero(kinds == kind)
        for start in range(0, len(members), _PIECE):
            here = members[start : start + _PIECE]
            surface = Surface.of(at[here], facing[here], seeds[here])
            albedo[here] = np.clip(MATERIALS[kind].texture(surface), 0.0, 1.0)
    return albedo
