"""Completes a cloud of any size: cut into tiles, each completed alone, put together again."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.cloud import PointCloud
from pcdbench.completer import Completer
from pcdbench.completion.completed import Completed
from pcdbench.completion.confidence import factors
from pcdbench.completion.surface import RADIUS_OF_SPACING
from pcdbench.completion.tile_work import AGREES_WITHIN, FEWEST_POINTS, TileResult, TileTask, observed_alone
from pcdbench.completion.tiles import SMALLEST_TILE_M, Index, Tiling
from pcdbench.completion.workers import tile_outcomes
from pcdbench.errors import CloudError, PcdbenchError
from pcdbench.formats.columns import needs_double
from pcdbench.geometry.extent import no_surface, odd_scale, strays, two_parts, where_strays_lie
from pcdbench.geometry.frames import Frame

if TYPE_CHECKING:
    from pcdbench.runner.selection import Plugin

# A window's outermost part is not asked for its opinion: a completer there knows one side only.
OPINION_MARGIN_M = 0.3
SEAM_RADII = 0.7
# Tiles are numbered, empty ones too.
MOST_TILES_LOG2 = 63.0

Progress = Callable[[int, int], None]


class CompletionWarning(UserWarning):
    """Something about a completion that its user should know; it went on. One line."""


def complete(
    cloud: PointCloud,
    completer: str | Completer,
    *,
    options: Mapping[str, object] | None = None,
    up: str = "z",
    tile_m: float | None = None,
    runs: int = 1,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
) -> Completed:
    """Complete a cloud of any size, and say how far each added point can be trusted.

    The cloud is cut into tiles with halos; in each, the completer gets an evenly thinned cloud of 4 cm spacing or
    more, upright and near the origin. What it adds farther than about a spacing from every observed point is new;
    that surface is sampled again at the density of the observed points around it.

    Args:
        cloud: metres, at any offset.
        completer: a name from `pcdbench list`, or a completer.
        options: of the named completer.
        up: the cloud's up axis: z, y, x, -z, -y or -x.
        tile_m: edge of a tile; by default the density decides.
        runs: how often the completer is asked, each time with another seed; the first answer is taken, the others
            count for the confidence.
        jobs: worker processes; 1 works in this process.
        seed: decides every random draw; the result does not depend on `jobs`.
        progress: called after every tile with the observed points done and all observed points.

    Raises:
        PcdbenchError: for an unknown completer, a wrong option or argument, or where the completer failed on
            every tile.
        CloudError: for a cloud of too few points, all on one line, or with a stray point so far away that they seem so.
    """
    chosen = _chosen(completer, options or {}, cloud)
    if runs < 1 or jobs < 1:
        raise PcdbenchError("runs and jobs must be at least 1")
    if len(cloud) < FEWEST_POINTS:
        raise CloudError(f"the cloud has {len(cloud)} points; at least {FEWEST_POINTS} are needed to complete it")
    wrong = no_surface(cloud.points) or _too_far_away(cloud.points)
    if wrong is not None:
        raise CloudError(wrong)
    frame = Frame.with_up(up)
    _warn_of_shape(cloud.points, frame, up)
    tiling = Tiling.of(cloud.points, frame, tile_m)
    results: dict[Index, TileResult] = {}
    failures: dict[Index, str] = {}
    done = 0
    for tile, outcome in tile_outcomes(_tasks(cloud, tiling, seed, runs), chosen, jobs):
        if isinstance(outcome, Exception):
            reason = " ".join(str(outcome).split())[:200]
            failures[tile] = f"{tiling.name(tile)}: {type(outcome).__name__}: {reason}"
            warnings.warn(f"nothing was added in {failures[tile]}", CompletionWarning, stacklevel=2)
        elif outcome is not None:
            results[tile] = outcome
        done += tiling.count(tile)
        if progress is not None:
            progress(done, len(cloud))
    if failures and not results:
        first = next(iter(failures.values()))
        raise PcdbenchError(f"the completer failed on all {len(failures)} tiles; the first: {first}")
    failures = dict(sorted(failures.items()))
    left = {}
    for tile in failures:
        try:
            outcome = observed_alone(_task(cloud, tiling, tile, seed, runs))
        except Exception:
            # Not the completer's doing, then: memory, say.
            failures[tile] += " (its area and its gaps are left out)"
        else:
            if outcome is not None:
                left[tile] = outcome
    return _assembled(cloud, tiling, dict(sorted(results.items())), left, tuple(failures.values()))


def _chosen(completer: str | Completer, options: Mapping[str, object], cloud: PointCloud) -> Plugin | Completer:
    """The completer to be built in each process, checked against what it is and what it needs."""
    from pcdbench.plugins import registry
    from pcdbench.runner.selection import select

    if isinstance(completer, Completer):
        name, cls = type(completer).__name__, type(completer)
        chosen: Plugin | Completer = completer
        if options:
            raise PcdbenchError(f"options are for named completers; give them to {name} when you build it")
    else:
        plugin = select("completer", completer, {key: str(value) for key, value in options.items()})
        if plugin.reference:
            raise PcdbenchError(f"{completer} is a reference to measure against, not a method; take another completer")
        name, cls, chosen = completer, registry().get("completer", completer).load(), plugin
    if cls.needs_color and cloud.colors is None:
        raise PcdbenchError(f"{name} needs colours, and the cloud has none; take another completer (pcdbench list)")
    return chosen


def _warn_of_shape(points: NDArray[np.float64], frame: Frame, up: str) -> None:
    sides = [float(np.ptp(frame.column(points, axis))) for axis in range(3)]
    longest = max(sides)
    odd = odd_scale(longest)
    if odd is not None:
        told = _few_far_away(points) or two_parts(points) or f"the {odd}"
        warnings.warn(told, CompletionWarning, stacklevel=3)
    elif sides[2] > 6 and sides[2] > 1.5 * max(sides[:2]):
        warnings.warn(
            f"the cloud is {sides[2]:.1f} m high and {max(sides[:2]):.1f} m wide; is {up} really its up axis? (--up)",
            CompletionWarning,
            stacklevel=3,
        )


def _few_far_away(points: NDArray[np.float64]) -> str | None:
    """What to say of a few stray points where the scan is as large as a building without them."""
    far = strays(points)
    if not len(far) or odd_scale(float(np.ptp(np.delete(points, far, axis=0), axis=0).max())) is not None:
        return None
    return where_strays_lie(points, far)


def _too_far_away(points: NDArray[np.float64]) -> str | None:
    """What to say of stray points so far away that the tiles between could not be numbered."""
    if float(np.log2(np.ptp(points, axis=0) / SMALLEST_TILE_M + 1.0).sum()) < MOST_TILES_LOG2:
        return None
    far = strays(points)
    return where_strays_lie(points, far) if len(far) else None


def _tasks(cloud: PointCloud, tiling: Tiling, seed: int, runs: int) -> Iterator[tuple[Index, TileTask]]:
    for tile in tiling.tiles:
        yield tile, _task(cloud, tiling, tile, seed, runs)


def _task(cloud: PointCloud, tiling: Tiling, tile: Index, seed: int, runs: int) -> TileTask:
    rows = tiling.window(tile)
    points = tiling.frame.upright(cloud.points[rows]) - tiling.center(tile)
    colors = None if cloud.colors is None else cloud.colors[rows]
    return TileTask(PointCloud(points, colors), tiling.edges_m / 2, (seed, *tile), runs)


def _assembled(
    cloud: PointCloud,
    tiling: Tiling,
    results: dict[Index, TileResult],
    left: dict[Index, TileResult],
    failures: tuple[str, ...],
) -> Completed:
    """The observed points, and what each tile added within its own bounds.

    Args:
        cloud: the observed points.
        tiling: of them.
        results: of the tiles that the completer completed.
        left: of tiles that it failed on: their areas and gaps count, and they have no say in anything else.
        failures: a line for each tile that it failed on.
    """
    placed = {tile: result.proposals + tiling.center(tile) for tile, result in results.items()}
    trees = {tile: cKDTree(places) for tile, places in placed.items() if len(places)}
    parts: dict[Index, NDArray[np.float64]] = {}
    colors, trust, weakest, spacings = [], [], [], []
    for tile, result in results.items():
        points = result.points + tiling.center(tile)
        kept = tiling.owned(tile, points)
        kept[kept] = _off_seams(points[kept], result.spacing_m[kept], tile, tiling, parts)
        seconded, asked = _opinions(tile, placed[tile], result, tiling, trees, results)
        of_proposal = factors(result.evidence, seconded, asked, result.own)
        parts[tile] = points[kept]
        parents, weights = result.parents[kept], result.weights[kept]
        trust.append(np.einsum("ap,ap->a", of_proposal.prod(axis=1)[parents], weights))
        weakest.append(of_proposal[parents[:, 0]].argmin(axis=1).astype(np.uint8))
        spacings.append(result.spacing_m[kept])
        if result.colors is not None:
            colors.append(result.colors[kept])
    new_points = _as_coarse(tiling.frame.back(np.concatenate([np.empty((0, 3)), *parts.values()])), cloud.points)
    count = len(new_points)
    points = np.concatenate([cloud.points, new_points])
    points.flags.writeable = False
    all_colors = None
    if cloud.colors is not None:
        all_colors = np.concatenate([cloud.colors, *colors])
        all_colors.flags.writeable = False
    gaps, gaps_m2 = [np.empty((0, 3))], [np.empty(0)]
    for tile, result in (results | left).items():
        places = result.gaps + tiling.center(tile)
        own = tiling.owned(tile, places)
        gaps.append(tiling.frame.back(places[own]))
        gaps_m2.append(result.gaps_m2[own])
    return Completed(
        cloud=PointCloud(points, all_colors),
        added=np.repeat([False, True], [len(cloud), count]),
        confidence=np.concatenate([np.ones(len(cloud), np.float32), *trust], dtype=np.float32, casting="same_kind"),
        spacing_m=np.concatenate([np.empty(0), *spacings]),
        weakest=np.concatenate([np.empty(0, np.uint8), *weakest]),
        gaps=np.concatenate(gaps),
        gaps_m2=np.concatenate(gaps_m2),
        surface_m2=sum(result.surface_m2 for result in (results | left).values()),
        frame=tiling.frame,
        tiles=len(results) + len(failures),
        failures=failures,
    )


def _as_coarse(new: NDArray[np.float64], observed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Added points on a grid of 0.1 mm, and in single precision where the observed points are: files stay small."""
    new = np.round(new, 4)
    is_single = not needs_double(observed, exact=True) and not needs_double(new)
    return new.astype(np.float32).astype(np.float64) if is_single else new


def _off_seams(
    points: NDArray[np.float64],
    spacing_m: NDArray[np.float64],
    tile: Index,
    tiling: Tiling,
    earlier: dict[Index, NDArray[np.float64]],
) -> NDArray[np.bool_]:
    """(M,) which points are not almost where an earlier tile, next to this one, put a point already."""
    free = np.ones(len(points), np.bool_)
    if not len(points):
        return free
    reach = float(spacing_m.max())
    for other in tiling.neighbors(tile):
        if other not in earlier:
            continue
        at_seam = np.flatnonzero(tiling.covers(other, points, tiling.halo_m - reach))
        facing = earlier[other][tiling.covers(tile, earlier[other], tiling.halo_m - reach)]
        if len(at_seam) and len(facing):
            gap, _ = cKDTree(facing).query(points[at_seam])
            free[at_seam] &= gap >= SEAM_RADII * RADIUS_OF_SPACING * spacing_m[at_seam]
    return free


def _opinions(
    tile: Index,
    places: NDArray[np.float64],
    result: TileResult,
    tiling: Tiling,
    trees: dict[Index, cKDTree],
    results: dict[Index, TileResult],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(K,) how many others put a point at each of a tile's proposals, and (K,) how many others could have."""
    seconded = result.seconded.copy()
    asked = np.full(len(places), result.asked)
    for other in tiling.neighbors(tile):
        if other not in results:
            continue
        known = np.flatnonzero(tiling.covers(other, places, OPINION_MARGIN_M))
        asked[known] += 1
        if len(known) and other in trees:
            gap, _ = trees[other].query(places[known])
            seconded[known] += gap <= AGREES_WITHIN * max(result.working_m, results[other].working_m)
    return seconded, asked
