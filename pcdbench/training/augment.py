"""What makes a generated truth as flawed and as varied as a real one, before anything is taken from it.

A network trained on perfect rooms closes every natural gap of a real scan (missing ceilings, scanner
shadows, glass), which the complete scan has too. So truths get gaps of their own first, and the network
learns to fill what there is evidence for and to leave the rest. All functions take and return arrays; the
generator is the only source of randomness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.geometry.neighbors import nearest
from pcdbench.geometry.poses import rotation_about
from pcdbench.geometry.sampling import first_of_each
from pcdbench.training.truths import Truth

STATION_STEP_RAD = 0.012  # a scanner's ray at the density of truths
WALL_POINTS_M2 = 1000

Points = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Recipe:
    """Which kinds of augmentation a stream has; a study leaves some out.

    Attributes:
        gaps: natural gaps of the truth.
        stations: only what a few scanner stations see.
        notches: corners and bays cut out of the plan.
        ghosts: what glass and mirrors put behind a wall.
        clutter: things that no furniture list has.
        density: several densities (and densities that fall with the distance).
        noise: range noise and floating points.
        pose: heading, mirroring, scale.
        color: light and camera.
    """

    gaps: bool = True
    stations: bool = True
    notches: bool = True
    ghosts: bool = True
    clutter: bool = True
    density: bool = True
    noise: bool = True
    pose: bool = True
    color: bool = True


FULL = Recipe()


def augmented(truth: Truth, rng: np.random.Generator, recipe: Recipe = FULL) -> Truth:
    """A truth as another survey of another room might have left it: gaps, ghosts, clutter, scale, heading, colours."""
    if recipe.clutter:
        truth = with_clutter(truth, rng)
    if recipe.ghosts:
        truth = with_ghosts(truth, rng)
    if recipe.notches:
        truth = with_notch(truth, rng)
    if recipe.stations:
        truth = truth.select(seen_from_stations(truth.cloud.points, rng))
    if recipe.gaps:
        truth = truth.select(natural_gaps(truth.cloud.points, rng))
    if recipe.density:
        truth = truth.select(far_thinned(truth.cloud.points, rng))
    cloud = truth.cloud
    if recipe.pose:
        cloud = reposed(cloud, rng)
    if recipe.color:
        cloud = recolored(cloud, rng)
    return Truth(cloud, truth.missed)


def natural_gaps(points: Points, rng: np.random.Generator) -> Mask:
    """(N,) mask of the points that a flawed survey would still have: at least a third of them.

    Balls (missed spots), discs of the floor (below a scanner), shadow cones behind them as seen from a scanner, half
    spaces (a missing ceiling or part of it, ends cut off in any direction), slabs, and next rooms that show through
    a doorway as a wedge.
    """
    seen = np.ones(len(points), dtype=bool)
    low, high = points.min(axis=0), points.max(axis=0)
    scanner = rng.uniform(low, high)
    for _ in range(rng.integers(0, 5)):
        center = points[rng.integers(len(points))]
        radius = rng.uniform(0.1, 0.9)
        seen &= _squared(points - center) > radius**2
    if rng.random() < 0.25:
        on_floor = _floor(points)
        for _ in range(rng.integers(1, 4)):
            below = points[on_floor[rng.integers(len(on_floor))], :2]
            seen[on_floor[_squared(points[on_floor, :2] - below) < rng.uniform(0.3, 1.2) ** 2]] = False
    for _ in range(rng.integers(0, 4)):
        seen &= ~_in_shadow(points, scanner, points[rng.integers(len(points))], rng.uniform(0.1, 0.5))
    if rng.random() < 0.35:
        below = points[:, 2] < high[2] - rng.uniform(0.05, 0.5) * (high[2] - low[2])
        if rng.random() < 0.4:
            # A part of the ceiling only: up to a line across it.
            axis = rng.integers(2)
            below |= points[:, axis] > rng.uniform(low[axis], high[axis])
        seen &= below
    for _ in range(rng.choice(3, p=[0.35, 0.4, 0.25])):
        along = points[:, :2] @ _heading(rng)
        seen &= along > along.min() + rng.uniform(0.02, 0.3) * np.ptp(along)
    if rng.random() < 0.35:
        seen &= ~_beyond_doorway(points, rng)
    if rng.random() < 0.3:
        # A slab: a strip of floor, wall or ceiling behind something that is not in the truth.
        normal = rng.normal(size=3) * (1.0, 1.0, 0.3)
        normal /= np.linalg.norm(normal)
        offset = (points - points[rng.integers(len(points))]) @ normal
        seen &= np.abs(offset) > rng.uniform(0.05, 0.4)
    return seen if seen.sum() > len(points) / 3 else np.ones(len(points), dtype=bool)


def _in_shadow(points: Points, scanner: Points, occluder: Points, radius: float) -> Mask:
    """(N,) mask of the points that a ball at `occluder` hides from `scanner`."""
    axis = occluder - scanner
    distance = float(np.linalg.norm(axis))
    if distance <= 2 * radius:
        return np.zeros(len(points), dtype=bool)
    ray = points - scanner
    along = ray @ (axis / distance)
    across = np.sqrt(np.maximum(_squared(ray) - along**2, 0.0))
    return (along > distance) & (across < along * radius / distance)


def _heading(rng: np.random.Generator) -> Points:
    """(2,) a horizontal direction: along an axis, as rooms are cut out of buildings, or any."""
    angle = rng.integers(4) * np.pi / 2 if rng.random() < 0.5 else rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _beyond_doorway(points: Points, rng: np.random.Generator) -> Mask:
    """(N,) mask of what lies behind an upright plane and does not show, from this side of it, through its doorway."""
    normal = _heading(rng)
    plan = points[:, :2]
    depth, across = plan @ normal, plan @ np.array([-normal[1], normal[0]])
    wall = depth.min() + rng.uniform(0.5, 0.95) * np.ptp(depth)
    scanner_depth = rng.uniform(depth.min(), wall - 0.05 * np.ptp(depth))
    scanner_across, doorway = rng.uniform(across.min(), across.max(), size=2)
    # Where the line of sight to each point crosses the plane.
    crossing = scanner_across + (across - scanner_across) * (wall - scanner_depth) / np.maximum(
        depth - scanner_depth, 1e-9
    )
    return (depth > wall) & (np.abs(crossing - doorway) > rng.uniform(0.3, 0.7))


def _squared(vectors: Points) -> Points:
    return np.einsum("ni,ni->n", vectors, vectors)


def _floor(points: Points) -> NDArray[np.int64]:
    """Rows about the floor's height: little lies below it, though clutter that stands on it may reach there."""
    height = np.percentile(points[:, 2], 5, method="lower")
    return np.flatnonzero(np.abs(points[:, 2] - height) < 0.15)


def seen_from_stations(points: Points, rng: np.random.Generator) -> Mask:
    """(N,) mask of what one to three scanner stations see, each past what stands in its way.

    Six truths in ten stay whole. The generated surveys have more stations than many a real one: below tables
    and behind cabinets floors and walls are missing there, in the complete scan too. Hidden is what lies well behind
    the nearest point in its direction.
    """
    seen = np.zeros(len(points), dtype=bool)
    if rng.random() < 0.6:
        return ~seen
    floor = _floor(points)
    for _ in range(rng.integers(1, 4)):
        station = points[floor[rng.integers(len(floor))]] + (0.0, 0.0, rng.uniform(1.0, 1.8))
        ray = points - station
        distance = np.sqrt(_squared(ray))
        azimuth = np.arctan2(ray[:, 1], ray[:, 0]) / STATION_STEP_RAD
        elevation = np.arcsin(ray[:, 2] / np.maximum(distance, 1e-9)) / STATION_STEP_RAD
        across = int(2 * np.pi / STATION_STEP_RAD) + 2
        direction = np.floor(elevation - elevation.min()).astype(np.int64) * across
        direction += np.floor(azimuth - azimuth.min()).astype(np.int64)
        first = np.full(int(direction.max()) + 1, np.inf)
        np.minimum.at(first, direction, distance)
        # A floor seen at a flat angle reaches far within one direction, the farther the more.
        seen |= distance < 0.1 + 1.06 * first[direction]
    return seen if seen.sum() > len(points) / 3 else np.ones(len(points), dtype=bool)


def with_notch(truth: Truth, rng: np.random.Generator) -> Truth:
    """The truth with a corner or a bay cut out of its plan, along walls of its own as often as not; once in three.

    Generated crops fill the convex hull of their plans; rooms of the shape of an L, a T or a U do not.
    """
    if rng.random() > 0.35:
        return truth
    u = np.array([1.0, 0.0]) if rng.random() < 0.8 else _heading(rng)
    u = u * rng.choice([-1.0, 1.0])
    v = np.array([-u[1], u[0]]) * rng.choice([-1.0, 1.0])
    if rng.random() < 0.5:
        u, v = v, u
    points = truth.cloud.points
    along, across = points[:, :2] @ u, points[:, :2] @ v
    depth = along.min() + rng.uniform(0.3, 0.8) * np.ptp(along)
    side = across.min() + rng.uniform(0.25, 0.75) * np.ptp(across)
    other = across.max() if rng.random() < 0.7 else side + rng.uniform(0.15, 0.4) * np.ptp(across)
    cut = (along > depth) & (across > side) & (across < other + 1e-6)
    left = truth.select(~cut)
    if len(left.cloud) < len(points) / 3:
        return truth
    if rng.random() < 0.5:
        return left
    # The walls, from floor to ceiling, where the cut passes through the room.
    z = np.percentile(points[:, 2], [1, 99])
    walls = [
        _upright(u * depth + v * side, u * depth + v * min(other, across.max()), z, rng),
        _upright(u * depth + v * side, u * along.max() + v * side, z, rng),
    ]
    if other < across.max():
        walls.append(_upright(u * depth + v * other, u * along.max() + v * other, z, rng))
    new = np.concatenate(walls)
    colors = None
    if truth.cloud.colors is not None:
        paint = truth.cloud.colors[rng.integers(len(points))] + rng.normal(scale=0.03, size=(len(new), 3))
        colors = np.clip(paint, 0, 1).astype(np.float32)
    missed = np.concatenate([left.missed, left.missed[nearest(new, left.cloud.points)[1]]])
    return Truth(PointCloud.concatenate([left.cloud, PointCloud(new, colors)]), missed)


def _upright(start: Points, end: Points, z: Points, rng: np.random.Generator) -> Points:
    """(K, 3) points of an upright rectangle above the segment from (2,) `start` to `end`, as dense as truths are."""
    length, height = float(np.linalg.norm(end - start)), float(z[1] - z[0])
    share, up = rng.random((2, int(length * height * WALL_POINTS_M2)))
    return np.column_stack([start + share[:, None] * (end - start), z[0] + up * height])


def far_thinned(points: Points, rng: np.random.Generator) -> Mask:
    """(N,) mask of what a scanner that thins out with the distance leaves; everything, half of the times."""
    if rng.random() < 0.5:
        return np.ones(len(points), dtype=bool)
    scanner = rng.uniform(points.min(axis=0), points.max(axis=0))
    distance = np.sqrt(_squared(points - scanner))
    return rng.random(len(points)) < np.clip((rng.uniform(2.0, 8.0) / np.maximum(distance, 0.1)) ** 2, 0.15, 1.0)


def with_clutter(truth: Truth, rng: np.random.Generator) -> Truth:
    """The truth with a few lumpy shells of any colour standing on its surfaces: things no furniture list has."""
    if rng.random() < 0.4:
        return truth
    clouds, missed = [truth.cloud], [truth.missed]
    for _ in range(rng.integers(1, 6)):
        count = int(rng.integers(300, 3000))
        directions = rng.normal(size=(count, 3))
        # The higher the norm, the more a shell is a rounded box and the less an ellipsoid.
        directions /= np.linalg.norm(directions, ord=rng.choice([2, 4, 10]), axis=1, keepdims=True)
        lumps = 1.0 + 0.15 * np.sin(directions @ rng.normal(scale=3.0, size=3) + rng.uniform(0, 6.3))
        shell = directions * rng.uniform(0.08, 0.45, size=3) * lumps[:, None]
        stands_at = rng.integers(len(truth.cloud))
        shell += truth.cloud.points[stands_at]
        color = rng.uniform(0.05, 0.95, size=3) + rng.normal(scale=0.03, size=(count, 3))
        colors = None if truth.cloud.colors is None else np.clip(color, 0, 1).astype(np.float32)
        clouds.append(PointCloud(shell, colors))
        missed.append(np.full(count, truth.missed[stands_at]))
    return Truth(PointCloud.concatenate(clouds), np.concatenate(missed))


def with_ghosts(truth: Truth, rng: np.random.Generator) -> Truth:
    """The truth with a thin mirror image of a part of it beyond a wall, as scanners see in glass; once in five."""
    if rng.random() > 0.2:
        return truth
    points = truth.cloud.points
    axis, side = rng.integers(2), rng.choice([-1.0, 1.0])
    wall = np.max(side * points[:, axis]) - rng.uniform(0.0, 0.3)
    depth = wall - side * points[:, axis]
    center = points[rng.integers(len(points))]
    seen = (depth > 0) & (depth < rng.uniform(0.5, 4.0)) & (_squared(points - center) < rng.uniform(0.7, 2.0) ** 2)
    ghosts = truth.select(seen & (rng.random(len(points)) < rng.uniform(0.05, 0.5)))
    mirrored = ghosts.cloud.points.copy()
    mirrored[:, axis] = side * (wall + (wall - side * mirrored[:, axis]))
    clouds = [truth.cloud, PointCloud(mirrored, ghosts.cloud.colors)]
    return Truth(PointCloud.concatenate(clouds), np.concatenate([truth.missed, ghosts.missed]))


def reposed(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    """The cloud turned to any heading, mirrored or not, and scaled by 0.8 to 1.25."""
    yaw = rng.uniform(0, 2 * np.pi) if rng.random() < 0.7 else rng.integers(4) * np.pi / 2
    R_new_old = rotation_about("z", yaw) * (1.0, rng.choice([-1.0, 1.0]), 1.0)
    scale = np.exp(rng.uniform(np.log(0.8), np.log(1.25)))
    return PointCloud(cloud.points @ R_new_old.T * scale, cloud.colors)


def recolored(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    """The cloud under another light and another camera: gain, gamma, a colour cast; channels permuted at times."""
    if cloud.colors is None:
        return cloud
    colors = cloud.colors.astype(np.float64)
    if rng.random() < 0.3:
        colors = colors[:, rng.permutation(3)]
    colors = colors ** rng.uniform(0.7, 1.4) * rng.uniform(0.7, 1.2) * rng.uniform(0.9, 1.1, size=3)
    return PointCloud(cloud.points, np.clip(colors, 0, 1).astype(np.float32))


def noisy(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    """The cloud with range noise of 0 to 12 mm and up to 0.5 % of its points floating anywhere near."""
    points = cloud.points + rng.normal(scale=rng.uniform(0.0, 0.012), size=cloud.points.shape)
    floating = rng.random(len(points)) < rng.uniform(0.0, 0.005)
    points = points + floating[:, None] * rng.normal(scale=0.3, size=points.shape)
    return PointCloud(points, cloud.colors)


def thinned(points: Points, spacing_m: float, rng: np.random.Generator) -> NDArray[np.int64]:
    """(M,) rows of about one point every `spacing_m`: by a grid, or plainly at random as often as not.

    Faster than a Poisson-disk sample by far, which a loader that makes several pairs a second needs.
    """
    edge = 0.9 * spacing_m
    cells = np.floor((points - points.min(axis=0)) / edge + rng.random(3)).astype(np.int64)
    extent = cells.max(axis=0) + 1
    order = rng.permutation(len(points))
    first = order[first_of_each(((cells[:, 0] * extent[1] + cells[:, 1]) * extent[2] + cells[:, 2])[order])]
    if rng.random() < 0.5:
        return first
    return order[: len(first)]
