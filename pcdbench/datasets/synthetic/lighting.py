"""The colors a scanner's camera sees: albedo under lamps and daylight, darker in corners and under furniture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.datasets.synthetic.building import Light
from pcdbench.datasets.synthetic.environment import Environment, Floats
from pcdbench.datasets.synthetic.materials import MATERIALS, colors
from pcdbench.geometry.sampling import stable_order
from pcdbench.threads import at_once, thread_count

AMBIENT = 0.5
NEAREST_LIGHTS = 6
OCCLUSION_RAYS = 8
OCCLUSION_RANGE_M = 0.8
OCCLUSION_SPACING_M = 0.12

_PIECE = 32768  # points at a time, whose arrays stay in the cache


def shaded_colors(
    environment: Environment, points: Floats, normals: Floats, triangles: NDArray[np.int64], occlusion: bool = True
) -> NDArray[np.float32]:
    """The colors of points on the environment's mesh under its lights.

    Args:
        points: (N, 3) metres, on the surface.
        normals: (N, 3) unit normals towards the viewer.
        triangles: (N,) rows of the environment's mesh.
        occlusion: darken corners and what stands under things; costs rays.

    Returns:
        (N, 3) float32 in [0, 1].
    """
    materials = environment.mesh.materials[triangles]

    def albedo() -> NDArray[np.float32]:
        local_points, local_normals = _in_piece_frames(environment, points, normals, triangles)
        return colors(local_points, local_normals, materials, environment.mesh.tints[triangles])

    def openness() -> NDArray[np.float32]:
        return _openness(environment, points, normals) if occlusion else np.ones(len(points), np.float32)

    base, light, open_share = at_once(albedo, lambda: _irradiance(environment, points, normals), openness)
    light *= open_share
    glow = np.array([material.glow for material in MATERIALS], np.float32)[materials]
    return np.clip(base * np.maximum(light, glow)[:, None], 0.0, 1.0)


def _in_piece_frames(
    environment: Environment, points: Floats, normals: Floats, triangles: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """Points and normals in the frames that the textures are fixed to."""
    poses = environment.poses[environment.pieces[triangles]]
    cos, sin = np.cos(poses[:, 3]), np.sin(poses[:, 3])
    offset = points - poses[:, :3]
    turned = [
        np.stack([x * cos + y * sin, y * cos - x * sin, z], axis=1) for x, y, z in (offset.T, np.asarray(normals).T)
    ]
    return turned[0], turned[1]


def _irradiance(environment: Environment, points: Floats, normals: Floats) -> NDArray[np.float32]:
    """(N,) ambient light and that of the nearest lamps and windows: distance squared, both cosines."""
    if not environment.lights:
        return np.full(len(points), AMBIENT, np.float32)
    total = np.empty(len(points), np.float32)
    for start in range(0, len(points), _PIECE):
        here = slice(start, start + _PIECE)
        total[here] = _ambient_and_direct(environment.lights, points[here], normals[here])
    return total / (0.75 + 0.35 * total)


def _ambient_and_direct(lights: Sequence[Light], points: Floats, normals: Floats) -> NDArray[np.float32]:
    """(N,) ambient light and that of the nearest lights."""
    where = np.array([light.position for light in lights])
    facing = np.array([light.facing for light in lights], np.float32)
    strength = np.float32(0.55) * np.array([light.strength for light in lights], np.float32)
    count = min(NEAREST_LIGHTS + 1, len(where))
    apart, nearest = (
        np.ascontiguousarray(found.T)
        for found in cKDTree(where).query(points, k=list(range(1, count + 1)), workers=thread_count())
    )
    total = np.full(len(points), AMBIENT, np.float32)
    (lx, ly, lz), (fx, fy, fz) = where.astype(np.float32).T.copy(), facing.T.copy()
    (px, py, pz), (nx, ny, nz) = points.T.astype(np.float32, order="C"), normals.T.astype(np.float32, order="C")
    fades = count < len(where)
    # Each light fades out towards the first one that is left out, so that no border shows.
    for k in range(count - fades):
        light = nearest[k]
        x, y, z = lx[light], ly[light], lz[light]
        x -= px
        y -= py
        z -= pz
        squared = x * x + y * y + z * z
        squared += np.float32(0.05)
        inverse = 1.0 / np.sqrt(squared)
        received = np.maximum((x * nx + y * ny + z * nz) * inverse, 0.0)
        emitted = np.clip(0.25 - 0.75 * (x * fx[light] + y * fy[light] + z * fz[light]) * inverse, 0.05, 1.0)
        arriving = strength[light]
        arriving *= received
        arriving *= emitted
        if fades:
            arriving *= np.clip(2.0 * (1.0 - apart[k] / apart[-1]), 0.0, 1.0).astype(np.float32)
        squared += np.float32(1.0)
        arriving /= squared
        total += arriving
    return total


def _openness(environment: Environment, points: Floats, normals: Floats) -> NDArray[np.float32]:
    """(N,) ambient occlusion: 1 in the open, less where much is near; computed on a sparse subset and spread."""
    number = np.zeros(len(points), np.int64)
    for axis, edge in [*((axis, OCCLUSION_SPACING_M) for axis in points.T), *((axis, 0.7) for axis in normals.T)]:
        cell = np.floor(axis / edge).astype(np.int64)
        cell -= cell.min()
        number = number * (int(cell.max()) + 1) + cell
    order = stable_order(number)
    new = np.diff(number[order], prepend=-1) > 0
    group = np.empty(len(points), np.int64)
    group[order] = np.cumsum(new) - 1
    first = order[new]
    at, up = points[first], normals[first]
    # Fibonacci points on a sphere around the normal's tip: directions with a cosine distribution.
    k = np.arange(OCCLUSION_RAYS) + 0.5
    z = 1 - 2 * k / OCCLUSION_RAYS
    angle = np.pi * (1 + 5**0.5) * k
    ball = np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)
    rays = up[:, None, :] * 1.02 + ball[None]
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    origins = np.repeat(at + 0.01 * up, OCCLUSION_RAYS, axis=0)
    reach = environment.raycaster.cast(origins, rays.reshape(-1, 3)).range_m.reshape(-1, OCCLUSION_RAYS)
    openness = np.clip(reach / OCCLUSION_RANGE_M, 0.0, 1.0).mean(axis=1)
    return (0.45 + 0.55 * openness).astype(np.float32)[group]
