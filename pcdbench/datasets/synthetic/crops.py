"""Crops: box-shaped parts of an environment, surveyed, sampled and tagged."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.datasets.synthetic.environment import Environment, Floats
from pcdbench.datasets.synthetic.layouts import LARGE_KINDS
from pcdbench.datasets.synthetic.scanning import Survey, scan
from pcdbench.geometry.sampling import poisson_disk_indices
from pcdbench.geometry.visibility import panorama_directions
from pcdbench.scene import TaggedObject
from pcdbench.threads import at_once

COMPLETE_POINTS = 20_000
MIN_OBJECT_POINTS = 30
MIN_OBJECTS = 3
MIN_DENSE_POINTS = 120_000
TRIES = 4
CENTER_CLEARANCE_M = 0.45
WALKABLE_M2 = 2.5


@dataclass(frozen=True, eq=False)
class Crop:
    """A surveyed part of an environment, in the environment's frame.

    Attributes:
        dense: the merged scan.
        complete_index: (20000,) rows of `dense`: blue noise.
        objects: the tagged objects that lie in the crop and were seen.
        survey: how it was scanned, for people.
    """

    dense: PointCloud
    complete_index: NDArray[np.int64]
    objects: tuple[TaggedObject, ...]
    survey: str


def crop_of(environment: Environment, rng: np.random.Generator) -> Crop:
    """A random crop whose middle is free floor, as the localization task needs it, and that shows a few objects."""
    for _ in range(TRIES):
        crop = _surveyed(environment, rng)
        if len(crop.objects) >= MIN_OBJECTS and len(crop.dense) >= MIN_DENSE_POINTS:
            break
    return crop


def _surveyed(environment: Environment, rng: np.random.Generator) -> Crop:
    """A random part of an environment as some survey sees it."""
    box = _box(environment, rng)
    survey = _survey(environment, box, rng)
    scanned = scan(environment, survey, box, rng)
    # As a file of 8-bit colors and single precision would hold it: the cached scene is the generated one.
    points = scanned.points.astype(np.float32).astype(np.float64)

    def sampling() -> NDArray:
        return poisson_disk_indices(points, COMPLETE_POINTS, order=np.argsort(scanned.lot))

    index, exact_colors = at_once(sampling, scanned.colors)
    colors = np.rint(exact_colors * 255).astype(np.uint8).astype(np.float32) / np.float32(255)
    seen = np.bincount(scanned.pieces[index], minlength=len(environment.poses))
    objects = tuple(
        tagged
        for tagged, piece in zip(environment.objects, environment.object_pieces, strict=True)
        if seen[piece] >= MIN_OBJECT_POINTS and _mostly_inside(tagged, box)
    )
    if survey.hand_held:
        how = f"hand-held depth camera, {len(survey.poses)} frames"
    else:
        how = f"{len(survey.poses)} scanner stations{'' if survey.ceiling else ', no ceiling'}"
    return Crop(PointCloud(points, colors), index, objects, how)


def _mostly_inside(tagged: TaggedObject, box: tuple[Floats, Floats]) -> bool:
    reach = 0.35 * float(np.hypot(*tagged.box.size[:2]))
    center = tagged.box.center[:2]
    return bool((center - reach >= box[0][:2]).all() and (center + reach <= box[1][:2]).all())


def _box(environment: Environment, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """The lowest and highest corner of a crop whose scanned extent is centred on free floor."""
    large = environment.kind in LARGE_KINDS
    low, high = environment.bounds
    candidates = _standing_places(environment)
    for _ in range(60):
        center = candidates[int(rng.integers(0, len(candidates)))]
        sides = (
            rng.uniform(8.0, 13.5) if large else rng.uniform(5.0, 8.0),
            rng.uniform(5.5, 9.5) if large else rng.uniform(4.5, 6.5),
        )
        half = np.array(sides if rng.uniform() < 0.5 else sides[::-1]) / 2
        box = (np.array([*(center - half), low[2] - 0.1]), np.array([*(center + half), high[2] + 0.1]))
        extent = _seen_extent(environment, box)
        if extent is None or np.ptp(extent, axis=0).max() < (6.5 if large else 4.0):
            continue
        middle = extent.mean(axis=0)
        if environment.floor.clearance_at(middle[None])[0] >= CENTER_CLEARANCE_M + 0.1:
            return box
        # Cut the longer sides, so that the extent is centred on the free place after all.
        reach = np.minimum(center - extent[0], extent[1] - center)
        if 2 * reach.max() >= (8.0 if large else 4.5) and 2 * reach.min() >= 2.6:
            return (np.array([*(center - reach), box[0][2]]), np.array([*(center + reach), box[1][2]]))
    reach = np.minimum(center - low[:2], high[:2] - center)
    return (np.array([*(center - reach), low[2] - 0.1]), np.array([*(center + reach), high[2] + 0.1]))


def _standing_places(environment: Environment) -> Floats:
    """(N, 2) free places with some floor around them that can be walked."""
    from scipy.ndimage import label, uniform_filter

    floor = environment.floor
    walkable = floor.clearance > 0.3
    area = uniform_filter(walkable.astype(np.float32), 31, mode="constant") * 31**2 * 0.01
    parts, _ = label(walkable)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    good = (
        (floor.clearance >= CENTER_CLEARANCE_M + 0.1)
        & (area > WALKABLE_M2)
        & (sizes[parts] > 100 * WALKABLE_M2)
        & floor.central
    )
    if not good.any():
        good = floor.clearance >= floor.clearance.max() - 0.05
    return floor.centers(np.argwhere(good))


def _seen_extent(environment: Environment, box: tuple[Floats, Floats]) -> Floats | None:
    """(2, 2) lowest and highest x, y that a quick survey sees in the box."""
    quick = _stations(environment, box, 6)
    rays = panorama_directions(4.0, -50.0, 30.0)
    found = []
    for station in quick:
        range_m = environment.raycaster.cast(station, rays).range_m
        hit = np.isfinite(range_m)
        points = station + rays[hit] * range_m[hit, None]
        found.append(points[((points >= box[0]) & (points <= box[1])).all(axis=1)])
    points = np.concatenate(found) if found else np.empty((0, 3))
    if len(points) < 200:
        return None
    return np.stack([points[:, :2].min(axis=0), points[:, :2].max(axis=0)])


def _stations(environment: Environment, box: tuple[Floats, Floats], at_most: int) -> Floats:
    """The stations in or near the box, those nearest to its middle first."""
    middle, half = (box[0] + box[1])[:2] / 2, (box[1] - box[0])[:2] / 2
    off = np.abs(environment.stations[:, :2] - middle)
    close = (off <= half + 1.5).all(axis=1)
    near = environment.stations[close] if close.any() else environment.stations
    return near[np.argsort(np.abs(near[:, :2] - middle).max(axis=1), kind="stable")][:at_most]


def _survey(environment: Environment, box: tuple[Floats, Floats], rng: np.random.Generator) -> Survey:
    """Mostly a scanner on stations; a depth camera carried by hand in some small rooms; now and then with a gap."""
    large = environment.kind in LARGE_KINDS
    stations = _stations(environment, box, 7 if large else 5)
    ceiling = bool(rng.uniform() > 0.15)
    if len(stations) > 2 and rng.uniform() < 0.25:
        stations = np.delete(stations, int(rng.integers(0, len(stations))), axis=0)
    turns = rng.uniform(-np.pi, np.pi, len(stations))
    survey = Survey(np.column_stack([stations, turns]), False, 0.42 if large else 0.36, ceiling, 25.0)
    if large or rng.uniform() > 0.25:
        return survey
    places = np.repeat(stations, 12, axis=0) + rng.normal(0.0, 0.25, (12 * len(stations), 3)) * [1.0, 1.0, 0.3]
    clear = environment.floor.clearance_at(places[:, :2]) > 0.15
    if not clear.any():
        return survey
    frames = np.column_stack(
        [places, np.tile(np.arange(12) * np.pi / 6, len(stations)) + rng.normal(0, 0.1, len(places))]
    )
    return replace(survey, poses=frames[clear], hand_held=True, max_range_m=6.5)
