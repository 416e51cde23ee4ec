"""Solids that rooms and furniture are made of; lengths in metres, z up, outward winding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcdbench.datasets.synthetic.mesh import Floats, Mesh
from pcdbench.datasets.synthetic.polygons import bridged, signed_area, triangulated

_BOX_CORNERS = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
_BOX_QUADS = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
_BOX_TRIANGLES = np.concatenate([_BOX_QUADS[:, [0, 1, 2]], _BOX_QUADS[:, [0, 2, 3]]])
_BOX_TRIANGLES.flags.writeable = False
# A box with longer sides than this has no triangle without area.
_SOLID_M = 1e-3

_DIRECTIONS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1]], np.float64)
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)


def box(size: ArrayLike, center: ArrayLike, material: str, tint: int = 0) -> Mesh:
    """A cuboid of `size` (x, y, z) around `center`."""
    extent = np.asarray(size, np.float64)
    corners = _BOX_CORNERS * extent + np.asarray(center, np.float64)
    made = Mesh.of_solid if extent.min() > _SOLID_M else Mesh.of
    return made(corners, _BOX_TRIANGLES, material, tint)


def boxes(sizes: ArrayLike, centers: ArrayLike, material: str, tints: ArrayLike = 0) -> Mesh:
    """Many cuboids of one material: `sizes` (B, 3) or (3,) around `centers` (B, 3), each with its own of `tints`."""
    middles = np.asarray(centers, np.float64).reshape(-1, 3)
    count = len(middles)
    extents = np.broadcast_to(np.asarray(sizes, np.float64), (count, 3))
    corners = _BOX_CORNERS[None] * extents[:, None] + middles[:, None]
    triangles = _BOX_TRIANGLES[None] + 8 * np.arange(count)[:, None, None]
    made = Mesh.of_solid if count and extents.min() > _SOLID_M else Mesh.of
    mesh = made(corners.reshape(-1, 3), triangles.reshape(-1, 3), material, 0)
    each = np.broadcast_to(np.asarray(tints, np.int64), (count,))
    return replace(mesh, tints=each[mesh.triangles[:, 0] // 8])


def surface(grid: ArrayLike, material: str, tint: int = 0, closed: bool = False) -> Mesh:
    """The surface through a (rows, columns, 3) grid of points; it faces along column step x row step.

    Args:
        closed: join the last column to the first.
    """
    points = np.asarray(grid, np.float64)
    rows, columns = points.shape[:2]
    return Mesh.of(points.reshape(-1, 3), _grid_triangles(rows, columns, closed), material, tint)


@lru_cache(maxsize=256)
def _grid_triangles(rows: int, columns: int, closed: bool) -> NDArray[np.int64]:
    """(T, 3) the triangles of a grid of points, numbered row by row; not to be written to."""
    index = np.arange(rows * columns).reshape(rows, columns)
    if closed:
        index = np.concatenate([index, index[:, :1]], axis=1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    triangles.flags.writeable = False
    return triangles


def prism(
    polygon: ArrayLike, z0: float, z1: float, material: str, tint: int = 0, holes: Sequence[ArrayLike] = ()
) -> Mesh:
    """A simple polygon (K, 2), with or without holes, extruded from `z0` to `z1`; any winding."""
    outer = _wound(polygon, 1.0)
    rings = [outer, *(_wound(hole, -1.0) for hole in holes)]
    flat = bridged(outer, rings[1:])
    ears = triangulated(flat)
    count = len(flat)
    floor, top = (np.column_stack([flat, np.full(count, z)]) for z in (z0, z1))
    vertices = [floor, top]
    triangles = [ears[:, ::-1], ears + count]
    start = 2 * count
    for ring in rings:
        side = len(ring)
        vertices += [np.column_stack([ring, np.full(side, z)]) for z in (z0, z1)]
        here = np.arange(side)
        after = (here + 1) % side
        triangles.append(np.stack([here, after, after + side], 1) + start)
        triangles.append(np.stack([here, after + side, here + side], 1) + start)
        start += 2 * side
    return Mesh.of(np.concatenate(vertices), np.concatenate(triangles), material, tint)


def profile_prism(profile: ArrayLike, x0: float, x1: float, material: str, tint: int = 0) -> Mesh:
    """A profile (K, 2) of (y, z) drawn out along x from `x0` to `x1`."""
    upright = prism(profile, x0, x1, material, tint)
    return replace(upright, vertices=upright.vertices[:, [2, 0, 1]])


def _wound(ring: ArrayLike, sign: float) -> Floats:
    points = np.asarray(ring, np.float64)
    return points if signed_area(points) * sign > 0 else points[::-1]


def panel_with_openings(
    width: float,
    height: float,
    thickness: float,
    openings: Sequence[tuple[float, float, float, float]],
    material: str,
    tint: int = 0,
    reveal_material: str | None = None,
    reveal_tint: int | None = None,
) -> Mesh:
    """A wall panel: x from 0 to `width`, z from 0 to `height`, y from -thickness/2 to thickness/2.

    Args:
        openings: rectangles (x0, x1, z0, z1) cut through, clipped to the panel; they may overlap.
        reveal_material: what the narrow faces (reveals, panel edges) are made of; by default as the panel.
    """
    xs = np.unique(np.clip([0.0, width, *(x for o in openings for x in o[:2])], 0.0, width))
    zs = np.unique(np.clip([0.0, height, *(z for o in openings for z in o[2:])], 0.0, height))
    mid_x, mid_z = np.meshgrid((xs[:-1] + xs[1:]) / 2, (zs[:-1] + zs[1:]) / 2, indexing="ij")
    solid = np.ones(mid_x.shape, bool)
    for x0, x1, z0, z1 in openings:
        solid &= ~((mid_x > x0) & (mid_x < x1) & (mid_z > z0) & (mid_z < z1))
    padded = np.pad(solid, 1)
    front, back = -thickness / 2, thickness / 2
    faces: list[list[list[float]]] = []
    edges: list[list[list[float]]] = []
    for i, k in np.argwhere(solid):
        x0, x1, z0, z1 = xs[i], xs[i + 1], zs[k], zs[k + 1]
        faces.append([[x0, front, z0], [x1, front, z0], [x1, front, z1], [x0, front, z1]])
        faces.append([[x1, back, z0], [x0, back, z0], [x0, back, z1], [x1, back, z1]])
        if not padded[i, k + 1]:
            edges.append([[x0, back, z0], [x0, front, z0], [x0, front, z1], [x0, back, z1]])
        if not padded[i + 2, k + 1]:
            edges.append([[x1, front, z0], [x1, back, z0], [x1, back, z1], [x1, front, z1]])
        if not padded[i + 1, k]:
            edges.append([[x0, back, z0], [x1, back, z0], [x1, front, z0], [x0, front, z0]])
        if not padded[i + 1, k + 2]:
            edges.append([[x0, front, z1], [x1, front, z1], [x1, back, z1], [x0, back, z1]])
    narrow = _quads(edges, reveal_material or material, tint if reveal_tint is None else reveal_tint)
    return Mesh.merge([_quads(faces, material, tint), narrow])


def _quads(quads: Sequence[ArrayLike], material: str, tint: int) -> Mesh:
    corners = np.arange(4 * len(quads)).reshape(-1, 4)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    return Mesh.of(np.asarray(quads, np.float64).reshape(-1, 3), triangles, material, tint)


def lathe(
    profile: ArrayLike, material: str, tint: int = 0, center: ArrayLike = (0.0, 0.0, 0.0), segments: int = 20
) -> Mesh:
    """A profile (K, 2) of (radius, z), from bottom to top on the outside, turned about the z axis through `center`."""
    radius, z = np.asarray(profile, np.float64).T[:, :, None]
    cos, sin = _circle(segments)
    grid = np.empty((len(radius), segments, 3))
    grid[..., 0], grid[..., 1], grid[..., 2] = radius * cos, radius * sin, z
    return surface(grid + np.asarray(center, np.float64), material, tint, closed=True)


@lru_cache(maxsize=64)
def _circle(segments: int) -> tuple[Floats, Floats]:
    """The cosines and the sines, (segments,) each, of as many directions around a circle; not to be written to."""
    angle = 2 * np.pi * np.arange(segments) / segments
    cos, sin = np.cos(angle), np.sin(angle)
    cos.flags.writeable = sin.flags.writeable = False
    return cos, sin


def cylinder(radius: float, height: float, base: ArrayLike, material: str, tint: int = 0, segments: int = 20) -> Mesh:
    """An upright closed cylinder; `base` is the centre of its bottom."""
    return frustum(radius, radius, height, base, material, tint, segments)


def frustum(
    bottom_radius: float,
    top_radius: float,
    height: float,
    base: ArrayLike,
    material: str,
    tint: int = 0,
    segments: int = 20,
) -> Mesh:
    """An upright closed cone, cut off unless `top_radius` is 0; `base` is the centre of its bottom."""
    profile = [(0.0, 0.0), (bottom_radius, 0.0), (top_radius, height), (0.0, height)]
    return lathe(profile, material, tint, base, segments)


def ellipsoid(
    radii: ArrayLike, center: ArrayLike, material: str, tint: int = 0, segments: int = 16, squareness: float = 1.0
) -> Mesh:
    """An ellipsoid; a `squareness` below 1 (to about 0.3) swells it towards its box, as cushions are."""
    rise = np.linspace(-np.pi / 2, np.pi / 2, max(5, segments // 2 + 1))[:, None]
    cos, sin = _circle(segments)
    flat = _power(np.cos(rise), squareness)
    grid = np.empty((len(rise), segments, 3))
    grid[..., 0], grid[..., 1] = flat * _power(cos, squareness), flat * _power(sin, squareness)
    grid[..., 2] = _power(np.sin(rise), max(squareness, 0.6))
    return surface(grid * np.asarray(radii, np.float64) + np.asarray(center, np.float64), material, tint, closed=True)


def _cross(a: Floats, b: Floats) -> Floats:
    """What `numpy.cross` gives for rows (N, 3) and a row or rows, in a quarter of its time."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    product = np.empty(a.shape)
    product[:, 0], product[:, 1], product[:, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return product


def _normalized(rows: Floats) -> Floats:
    """What dividing rows (N, 3) by their `numpy.linalg.norm` gives, in a third of its time."""
    return rows / np.sqrt(np.add.reduce(rows * rows, axis=1, keepdims=True))


def _along(path: Floats, closed: bool) -> Floats:
    """(K, 3) how a path, a ring if `closed`, goes at each point: `numpy.gradient` takes six times as long."""
    if closed:
        return np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0)
    along = np.empty_like(path)
    along[1:-1] = (path[2:] - path[:-2]) / 2.0
    along[0], along[-1] = path[1] - path[0], path[-1] - path[-2]
    return along


def _power(values: Floats, exponent: float) -> Floats:
    return np.sign(values) * np.where(np.abs(values) < 1e-9, 0.0, np.abs(values)) ** exponent


def sphere(radius: float, center: ArrayLike, material: str, tint: int = 0, segments: int = 16) -> Mesh:
    """A sphere around `center`."""
    return ellipsoid((radius, radius, radius), center, material, tint, segments)


def tube(
    path: ArrayLike,
    radius: float | Sequence[float] | Floats,
    material: str,
    tint: int = 0,
    segments: int = 8,
    closed: bool = False,
) -> Mesh:
    """A round tube along a path (K, 3), with one radius or one a point; `closed` makes a ring of it.

    Its circles are turned by the one of seven directions that the path keeps furthest from: no twist, no pinch.
    """
    points = np.asarray(path, np.float64)
    tangents = _normalized(_along(points, closed))
    # Rounded, so that a tie is broken alike on every machine.
    closeness = np.round(np.abs(_DIRECTIONS @ tangents.T).max(axis=1), 6)
    reference = _DIRECTIONS[np.argmin(closeness)]
    across = _normalized(_cross(tangents, reference))
    side = _cross(tangents, across)
    cos, sin = _circle(segments)
    circles = cos[:, None] * across[:, None] + sin[:, None] * side[:, None]
    rings = points[:, None] + np.asarray(radius, np.float64).reshape(-1, 1, 1) * circles
    if closed:
        return surface(np.concatenate([rings, rings[:1]]), material, tint, closed=True)
    caps = np.repeat(points[[0, -1], None], segments, axis=1)
    return surface(np.concatenate([caps[:1], rings, caps[1:]]), material, tint, closed=True)


def torus(ring_radius: float, radius: float, center: ArrayLike, material: str, tint: int = 0) -> Mesh:
    """A horizontal ring: rims of bins, pots and lamps."""
    angle = 2 * np.pi * np.arange(20) / 20
    circle = np.stack([ring_radius * np.cos(angle), ring_radius * np.sin(angle), np.zeros(20)], axis=1)
    return tube(circle + np.asarray(center, np.float64), radius, material, tint, segments=6, closed=True)


def rounded_box(
    size: ArrayLike, center: ArrayLike, radius: float, material: str, tint: int = 0, steps: int = 2
) -> Mesh:
    """A cuboid with edges and corners rounded by `radius` (at most half its least side), in `steps` facets each."""
    half = np.asarray(size, np.float64) / 2
    radius = min(radius, float(half.min()) * 0.999)
    quarter = np.linspace(0.0, np.pi / 2, steps + 1)
    turns = np.concatenate([quarter + corner * np.pi / 2 for corner in range(4)])
    sign_x = np.repeat([1.0, -1.0, -1.0, 1.0], steps + 1)
    sign_y = np.repeat([1.0, 1.0, -1.0, -1.0], steps + 1)
    rises = np.concatenate([quarter - np.pi / 2, quarter])
    sign_z = np.repeat([-1.0, 1.0], steps + 1)
    inner = half - radius
    out = (radius * np.cos(rises))[:, None]
    grid = np.zeros((len(rises) + 2, len(turns), 3))
    grid[1:-1, :, 0] = sign_x * inner[0] + out * np.cos(turns)
    grid[1:-1, :, 1] = sign_y * inner[1] + out * np.sin(turns)
    grid[1:-1, :, 2] = (sign_z * inner[2] + radius * np.sin(rises))[:, None]
    grid[0, :, 2], grid[-1, :, 2] = -half[2], half[2]
    return surface(grid + np.asarray(center, np.float64), material, tint, closed=True)


def sheet(heights: ArrayLike, size: tuple[float, float], thickness: float, material: str, tint: int = 0) -> Mesh:
    """A lying cloth: a grid of heights (rows along y, columns along x) over `size` around the origin, with a back."""
    tops = np.asarray(heights, np.float64)
    rows, columns = tops.shape
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, columns) * size[0], np.linspace(-0.5, 0.5, rows) * size[1])
    top = np.stack([x, y, tops], axis=-1)
    under = top - [0.0, 0.0, thickness]
    rim = np.concatenate([grid_border(top)[None], grid_border(under)[None]])
    return Mesh.merge(
        [
            surface(top, material, tint),
            surface(under[::-1], material, tint),
            surface(rim[::-1], material, tint, closed=True),
        ]
    )


def grid_border(grid: Floats) -> Floats:
    """(K, 3) the border of a (rows, columns, 3) grid, first along the columns."""
    return np.concatenate([grid[0, :-1], grid[:-1, -1], grid[-1, :0:-1], grid[:0:-1, 0]])
