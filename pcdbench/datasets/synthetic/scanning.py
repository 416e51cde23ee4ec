"""Simulated surveys: what scanner stations, or a hand-held walk, get back from an environment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pcdbench.datasets.synthetic.environment import Environment, Floats
from pcdbench.datasets.synthetic.lighting import shaded_colors
from pcdbench.datasets.synthetic.materials import MATERIALS
from pcdbench.geometry.sampling import first_of_each
from pcdbench.geometry.visibility import camera_directions, panorama_directions

MAX_POINTS = 360_000
VOXEL_M = 0.015
MIXED_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class Survey:
    """How an environment is scanned.

    Attributes:
        poses: (S, 4) x, y, z and yaw of each station or frame.
        hand_held: whether a depth camera is carried along the poses, not a scanner put on each.
        step_deg: angle between a scanner's neighbouring rays.
        ceiling: whether the scanner looks up at all.
        max_range_m: beyond it nothing returns.
    """

    poses: Floats
    hand_held: bool
    step_deg: float
    ceiling: bool
    max_range_m: float


@dataclass(frozen=True, eq=False)
class Scan:
    """The merged, thinned cloud of a survey; its colors are made when they are asked for.

    Attributes:
        environment: what was scanned.
        points: (N, 3) float64 metres, with noise.
        normals: (N, 3) unit, towards the scanner, of what each point was measured on.
        triangles: (N,) rows of the environment's mesh that they were measured on.
        exposure: (N, 3) float32 by which the camera brightens or dims each point's color.
        color_noise: (N, 3) float32 what the camera's sensor adds.
    """

    environment: Environment
    points: Floats
    normals: Floats
    triangles: NDArray[np.int64]
    exposure: NDArray[np.float32]
    color_noise: NDArray[np.float32]

    @property
    def pieces(self) -> NDArray[np.int32]:
        """(N,) the piece that each point was measured on."""
        return self.environment.pieces[self.triangles]

    def colors(self) -> NDArray[np.float32]:
        """(N, 3) float32 in [0, 1], computed anew by each call."""
        light = shaded_colors(self.environment, self.points, self.normals, self.triangles)
        return np.clip(light * self.exposure + self.color_noise, 0.0, 1.0).astype(np.float32)


def scan(environment: Environment, survey: Survey, box: tuple[Floats, Floats], rng: np.random.Generator) -> Scan:
    """What the survey brings home from within `box` (lowest and highest corner)."""
    parts = [_returns(environment, survey, pose, box, rng) for pose in survey.poses]
    points = np.concatenate([part[0] for part in parts])
    kept = _thinned(points, rng)
    points, normals, triangles = points[kept], *(np.concatenate([part[k] for part in parts])[kept] for k in (1, 2))
    exposure = np.clip(rng.normal(1.0, 0.035, (len(parts), 3)) * rng.normal(1.0, 0.05, (len(parts), 1)), 0.8, 1.2)
    first_frame = np.cumsum([0] + [len(part[0]) for part in parts])
    frame = np.searchsorted(first_frame, kept, side="right") - 1
    noise = rng.normal(0.0, 0.018, (len(points), 3)).astype(np.float32)
    return Scan(environment, points, normals, triangles, exposure.astype(np.float32)[frame], noise)


def _returns(
    environment: Environment, survey: Survey, pose: Floats, box: tuple[Floats, Floats], rng: np.random.Generator
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Points, normals and triangles that one station or frame measured within the box."""
    if survey.hand_held:
        tilt = np.radians(rng.uniform(-28.0, 22.0))
        level = camera_directions(77.0, 144, 108)
        c, s = np.cos(tilt), np.sin(tilt)
        seen = level @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    else:
        seen = _panorama(survey.step_deg, 90.0 if survey.ceiling else 12.0)
    directions = _turned(seen, float(pose[3]))
    hits = environment.raycaster.cast(pose[:3], directions)
    reached = np.where(np.isfinite(hits.range_m), hits.range_m, 0.0)
    near = (reached > 0.3) & (reached < survey.max_range_m)
    # By columns here and below: numpy is slow on rows of three.
    for k in range(3):
        end = pose[k] + directions[:, k] * reached
        near &= (end > box[0][k] - 0.5) & (end < box[1][k] + 0.5)
    rows = np.flatnonzero(near)
    beyond = np.roll(reached, -1)[rows]
    towards, range_m, normals = directions[rows], reached[rows], hits.normals[rows]
    triangle = environment.opaque[hits.triangle[rows]]
    incidence = -np.einsum("ij,ij->i", normals, towards)
    lost = np.array([1.0 if material.mirror else material.dropout for material in MATERIALS])
    # At grazing incidence little light comes back, the less the farther away.
    back = np.clip(incidence * 14.0 / np.maximum(1.0, range_m / 4.0), 0.0, 1.0)
    back *= 1.0 - lost[environment.mesh.materials[triangle]]
    returned = rng.uniform(size=len(rows)) < back
    sigma = np.minimum((0.003 if survey.hand_held else 0.002) + 0.0006 * range_m, 0.007)
    noisy = range_m + rng.normal(0.0, 1.0, len(rows)) * sigma
    # Mixed pixels: a beam on a depth edge returns something between its two surfaces.
    step = np.where(beyond > 0, np.abs(beyond - range_m), 0.0)
    mixed = (step > 0.15) & (step < 3.0) & (rng.uniform(size=len(rows)) < MIXED_SHARE)
    noisy = np.where(mixed, range_m + (beyond - range_m) * rng.uniform(size=len(rows)), noisy)
    for k in range(3):
        end = pose[k] + towards[:, k] * noisy
        returned &= (end >= box[0][k]) & (end <= box[1][k])
    inside = np.flatnonzero(returned)
    # Stations are registered to each other with a small error.
    offset, turn = rng.normal(0.0, 0.002, 3), rng.normal(0.0, 0.0003)
    moved = pose[:3] + towards[inside] * noisy[inside, None] + offset
    arm = moved - pose[:3]
    moved[:, 0] -= turn * arm[:, 1]
    moved[:, 1] += turn * arm[:, 0]
    return moved, normals[inside], triangle[inside]


def _turned(directions: Floats, yaw_rad: float) -> Floats:
    """Directions (R, 3) turned about the z axis; by columns: a product with a matrix takes eighteen times as long."""
    x, y, z = np.ascontiguousarray(directions.T)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    turned = np.empty_like(directions)
    turned[:, 0], turned[:, 1], turned[:, 2] = x * cos - y * sin, x * sin + y * cos, z
    return turned


@lru_cache(maxsize=4)
def _panorama(step_deg: float, max_elevation_deg: float) -> Floats:
    """The directions of a scanner's rays in its own frame; the tripod hides what is right below it."""
    return panorama_directions(step_deg, -62.0, max_elevation_deg)


def _thinned(points: Floats, rng: np.random.Generator) -> NDArray[np.int64]:
    """Sorted rows of at most `MAX_POINTS` points: one in each voxel, of 15 mm or as large as it takes."""
    edge = VOXEL_M
    x, y, z = np.ascontiguousarray(points.T)
    offset = np.array([x.min(), y.min(), z.min()]) - rng.uniform(0.0, 0.01, 3) if len(points) else np.zeros(3)
    kept = np.arange(len(points))
    while True:
        i, j, k = (((axis[kept] - low) / edge).astype(np.int64) for axis, low in zip((x, y, z), offset, strict=True))
        kept = kept[first_of_each((i << 26) | (j << 13) | k)]
        if len(kept) <= MAX_POINTS:
            return kept
        edge *= max(1.05, (len(kept) / MAX_POINTS) ** 0.5)
