"""Simulated surveys: what scanner stations, or a hand-held walk, get back from an environment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcdbench.datasets.synthetic.environment import Environment, Floats
from pcdbench.datasets.synthetic.lighting import shaded_colors
from pcdbench.datasets.synthetic.materials import MATERIALS
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
    """The merged, thinned cloud of a survey.

    Attributes:
        points: (N, 3) float64 metres, with noise.
        colors: (N, 3) float32 in [0, 1].
        pieces: (N,) int32 the piece that each point was measured on.
    """

    points: Floats
    colors: NDArray[np.float32]
    pieces: NDArray[np.int32]


def scan(environment: Environment, survey: Survey, box: tuple[Floats, Floats], rng: np.random.Generator) -> Scan:
    """What the survey brings home from within `box` (lowest and highest corner)."""
    parts = [_returns(environment, survey, pose, box, rng) for pose in survey.poses]
    points, normals, triangles, station = (np.concatenate([part[k] for part in parts]) for k in range(4))
    kept = _thinned(points, rng)
    points, normals, triangles, station = points[kept], normals[kept], triangles[kept], station[kept]
    colors = shaded_colors(environment, points, normals, triangles)
    exposure = np.clip(rng.normal(1.0, 0.035, (len(parts), 3)) * rng.normal(1.0, 0.05, (len(parts), 1)), 0.8, 1.2)
    first_frame = np.cumsum([0] + [len(part[0]) for part in parts])
    frame = np.searchsorted(first_frame, kept, side="right") - 1
    colors = colors * exposure[frame].astype(np.float32) + rng.normal(0.0, 0.018, (len(points), 3)).astype(np.float32)
    return Scan(points, np.clip(colors, 0.0, 1.0).astype(np.float32), environment.pieces[triangles])


def _returns(
    environment: Environment, survey: Survey, pose: Floats, box: tuple[Floats, Floats], rng: np.random.Generator
) -> tuple[Floats, Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Points, normals and triangles that one station or frame measured within the box."""
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    R_scene_scanner = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    if survey.hand_held:
        tilt = np.radians(rng.uniform(-28.0, 22.0))
        level = camera_directions(77.0, 144, 108)
        c, s = np.cos(tilt), np.sin(tilt)
        seen = level @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    else:
        seen = panorama_directions(survey.step_deg, -62.0, 90.0 if survey.ceiling else 12.0)
    directions = seen @ R_scene_scanner.T
    hits = environment.raycaster.cast(pose[:3], directions)
    range_m = hits.range_m
    incidence = -np.einsum("ij,ij->i", hits.normals, directions)
    triangle = environment.opaque[hits.triangle]
    materials = environment.mesh.materials[triangle]
    lost = np.array([1.0 if material.mirror else material.dropout for material in MATERIALS])[materials]
    # At grazing incidence little light comes back, the less the farther away.
    back = np.clip(incidence * 14.0 / np.maximum(1.0, range_m / 4.0), 0.0, 1.0) * (1.0 - lost)
    returned = np.isfinite(range_m) & (range_m < survey.max_range_m) & (rng.uniform(size=len(range_m)) < back)
    measured = np.where(np.isfinite(range_m), range_m, 0.0)
    sigma = (0.002 if not survey.hand_held else 0.003) + 0.0006 * measured
    noisy = measured + rng.normal(0.0, 1.0, len(measured)) * np.minimum(sigma, 0.007)
    # Mixed pixels: a beam on a depth edge returns something between its two surfaces.
    other = np.roll(measured, -1)
    edge = np.isfinite(range_m) & (other > 0) & (np.abs(other - measured) > 0.15) & (np.abs(other - measured) < 3.0)
    mixed = edge & (rng.uniform(size=len(edge)) < MIXED_SHARE)
    noisy = np.where(mixed, measured + (other - measured) * rng.uniform(size=len(edge)), noisy)
    points = pose[:3] + directions * noisy[:, None]
    inside = np.flatnonzero(returned & (points >= box[0]).all(axis=1) & (points <= box[1]).all(axis=1))
    # Stations are registered to each other with a small error.
    offset, turn = rng.normal(0.0, 0.002, 3), rng.normal(0.0, 0.0003)
    moved = points[inside] + offset
    arm = moved - pose[:3]
    moved[:, 0] -= turn * arm[:, 1]
    moved[:, 1] += turn * arm[:, 0]
    return moved, hits.normals[inside], triangle[inside], inside


def _thinned(points: Floats, rng: np.random.Generator) -> NDArray[np.int64]:
    """Sorted rows of at most `MAX_POINTS` points: one in each voxel, of 15 mm or as large as it takes."""
    edge = VOXEL_M
    offset = points.min(axis=0) - rng.uniform(0.0, 0.01, 3) if len(points) else np.zeros(3)
    kept = np.arange(len(points))
    while True:
        cells = ((points[kept] - offset) / edge).astype(np.int64)
        _, first = np.unique((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2], return_index=True)
        kept = kept[np.sort(first)]
        if len(kept) <= MAX_POINTS:
            return kept
        edge *= max(1.05, (len(kept) / MAX_POINTS) ** 0.5)
