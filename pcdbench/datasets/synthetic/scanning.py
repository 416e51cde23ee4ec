"""Simulated surveys: what scanner stations, or a hand-held walk, get back from an environment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from pcdbench.datasets.synthetic.environment import Environment, Floats
from pcdbench.datasets.synthetic.lighting import shaded_colors
from pcdbench.geometry.sampling import first_of_each
from pcdbench.geometry.visibility import camera_directions, panorama_directions, row_products
from pcdbench.threads import at_once

MAX_POINTS = 360_000
VOXEL_M = 0.015
MIXED_SHARE = 0.02

_PIECE = 32768  # points at a time


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
        lot: (N,) random numbers, of the rays that the points came from: they decide who is drawn.
    """

    environment: Environment
    points: Floats
    normals: Floats
    triangles: NDArray[np.int64]
    exposure: NDArray[np.float32]
    color_noise: NDArray[np.float32]
    lot: Floats

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
    views, chances = _views(environment, survey, box, rng)
    parts = at_once(
        *(
            partial(_returns, survey, pose, box, view, chance)
            for pose, view, chance in zip(survey.poses, views, chances, strict=True)
        )
    )
    merged = np.concatenate([points for points, _ in parts])
    kept = _thinned(merged, rng)
    first_of_part = np.cumsum([0] + [len(points) for points, _ in parts])
    exposure = np.clip(rng.normal(1.0, 0.035, (len(parts), 3)) * rng.normal(1.0, 0.05, (len(parts), 1)), 0.8, 1.2)
    part = np.searchsorted(first_of_part, kept, side="right") - 1
    # Only now what the points were measured on: most of them were thinned out.
    rows_of_view = np.split(kept, np.searchsorted(kept, first_of_part[1:-1]))
    rows_of_view = [
        returned[rows - first]
        for rows, first, (_, returned) in zip(rows_of_view, first_of_part[:-1], parts, strict=True)
    ]
    rays = [(chance, view.rays[rows]) for chance, view, rows in zip(chances, views, rows_of_view, strict=True)]
    noise = np.concatenate([chance.color_noise[its] for chance, its in rays])
    lot = np.concatenate([chance.lot[its] for chance, its in rays])
    normals = np.concatenate([view.normals[rows] for view, rows in zip(views, rows_of_view, strict=True)])
    hit = np.concatenate([view.triangles[rows] for view, rows in zip(views, rows_of_view, strict=True)])
    return Scan(
        environment, merged[kept], normals, environment.opaque[hit], exposure.astype(np.float32)[part], noise, lot
    )


@dataclass(frozen=True, eq=False)
class _View:
    """What the N rays of one station or frame met that ended in the box or near it.

    Attributes:
        towards: (N, 3) unit directions.
        range_m: (N,) metres to what they met.
        beyond_m: (N,) metres to what the next ray met, 0 where nothing.
        normals: (N, 3) unit, towards the scanner.
        triangles: (N,) rows of the environment's opaque triangles.
        rays: (N,) their numbers among all that were sent out.
        back: (N,) the probability that light comes back.
    """

    towards: Floats
    range_m: Floats
    beyond_m: Floats
    normals: Floats
    triangles: NDArray[np.int64]
    rays: NDArray[np.int64]
    back: Floats


@dataclass(frozen=True, eq=False)
class _Chance:
    """The random numbers of one station or frame: of each ray that it sends out, and of its registration.

    Rays that come to nothing have theirs too: whether one ray does must not change what another measures.
    """

    returns: Floats
    range_error: Floats
    mixes: Floats
    mixture: Floats
    color_noise: NDArray[np.float32]
    lot: Floats
    offset: Floats
    turn: float

    @staticmethod
    def of(count: int, rng: np.random.Generator) -> _Chance:
        """Those of a view of `count` rays."""
        returns, range_error = rng.uniform(size=count), rng.normal(0.0, 1.0, count)
        mixes, mixture = rng.uniform(size=count), rng.uniform(size=count)
        color_noise = np.float32(0.018) * rng.standard_normal((count, 3), dtype=np.float32)
        lot = rng.uniform(size=count)
        # Stations are registered to each other with a small error.
        offset, turn = rng.normal(0.0, 0.002, 3), rng.normal(0.0, 0.0003)
        return _Chance(returns, range_error, mixes, mixture, color_noise, lot, offset, turn)


def _views(
    environment: Environment, survey: Survey, box: tuple[Floats, Floats], rng: np.random.Generator
) -> tuple[list[_View], list[_Chance]]:
    """What every station or frame sees, and its random numbers, which are drawn one after the other."""
    if survey.hand_held:
        views, chances = [], []
        for pose in survey.poses:
            rays = _tilted(float(np.radians(rng.uniform(-28.0, 22.0))))
            views.append(_view(environment, survey, pose, rays, box))
            chances.append(_Chance.of(len(rays), rng))
        return views, chances
    rays = _panorama(survey.step_deg, 90.0 if survey.ceiling else 12.0)
    views = at_once(*(partial(_view, environment, survey, pose, rays, box) for pose in survey.poses))
    return views, [_Chance.of(len(rays), rng) for _ in views]


def _view(environment: Environment, survey: Survey, pose: Floats, rays: Floats, box: tuple[Floats, Floats]) -> _View:
    """What the rays, in the scanner's own frame, meet from a pose."""
    directions = _turned(rays, float(pose[3]))
    hits = environment.raycaster.cast(pose[:3], directions)
    reached = np.where(np.isfinite(hits.range_m), hits.range_m, 0.0)
    near = (reached > 0.3) & (reached < survey.max_range_m)
    # By columns here and below: numpy is slow on rows of three.
    for k in range(3):
        end = pose[k] + directions[:, k] * reached
        near &= (end > box[0][k] - 0.5) & (end < box[1][k] + 0.5)
    rows = np.flatnonzero(near)
    towards, range_m, normals, triangles = directions[rows], reached[rows], hits.normals[rows], hits.triangle[rows]
    incidence = -row_products(normals, towards)
    # At grazing incidence little light comes back, the less the farther away.
    back = np.clip(incidence * 14.0 / np.maximum(1.0, range_m / 4.0), 0.0, 1.0)
    back *= environment.reflectance[triangles]
    return _View(towards, range_m, np.roll(reached, -1)[rows], normals, triangles, rows, back)


def _returns(
    survey: Survey, pose: Floats, box: tuple[Floats, Floats], view: _View, chance: _Chance
) -> tuple[Floats, NDArray[np.int64]]:
    """The points that one station or frame measured within the box, and the rows of its view that they are of."""
    returned = chance.returns[view.rays] < view.back
    sigma = np.minimum((0.003 if survey.hand_held else 0.002) + 0.0006 * view.range_m, 0.007)
    noisy = view.range_m + chance.range_error[view.rays] * sigma
    # Mixed pixels: a beam on a depth edge returns something between its two surfaces.
    further = view.beyond_m - view.range_m
    step = np.where(view.beyond_m > 0, np.abs(further), 0.0)
    mixed = np.flatnonzero((step > 0.15) & (step < 3.0) & (chance.mixes[view.rays] < MIXED_SHARE))
    noisy[mixed] = view.range_m[mixed] + further[mixed] * chance.mixture[view.rays[mixed]]
    for k in range(3):
        end = pose[k] + view.towards[:, k] * noisy
        returned &= (end >= box[0][k]) & (end <= box[1][k])
    inside = np.flatnonzero(returned)
    moved = pose[:3] + view.towards[inside] * noisy[inside, None] + chance.offset
    arm = moved - pose[:3]
    moved[:, 0] -= chance.turn * arm[:, 1]
    moved[:, 1] += chance.turn * arm[:, 0]
    return moved, inside


def _tilted(tilt_rad: float) -> Floats:
    """The rays of a depth camera that looks up (or, below 0, down) by `tilt_rad`, in the frame of who holds it."""
    c, s = np.cos(tilt_rad), np.sin(tilt_rad)
    return camera_directions(77.0, 144, 108) @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


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
    left = np.ascontiguousarray(points.T)
    origin = np.floor(left.min(axis=1)) - rng.uniform(0.0, 0.01, 3) if len(points) else np.zeros(3)
    kept = np.arange(len(points))
    while True:
        first = first_of_each(_voxel_numbers(left, origin, edge))
        kept, left = kept[first], left.take(first, axis=1)
        if len(kept) <= MAX_POINTS:
            return kept
        # In steps of 5 %, so that a point more or less does not move every voxel.
        edge *= 1.05 ** max(1.0, np.ceil(np.log((len(kept) / MAX_POINTS) ** 0.5) / np.log(1.05)))


def _voxel_numbers(columns: Floats, origin: Floats, edge: float) -> NDArray[np.int64]:
    """(N,) the number of the voxel of each of (3, N) points; piece by piece, whose arrays stay in the cache."""
    numbers = np.zeros(columns.shape[1], np.int64)
    for start in range(0, len(numbers), _PIECE):
        here = numbers[start : start + _PIECE]
        for axis, low in zip(columns, origin, strict=True):
            here <<= 13
            here |= ((axis[start : start + _PIECE] - low) / edge).astype(np.int64)
    return numbers
