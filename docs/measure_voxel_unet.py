"""Measures voxel_unet: what its threshold trades, whether its confidence is calibrated, what a cloud costs.

`python docs/measure_voxel_unet.py [ROOMS [FOLDER]]`: so many rooms of the split `val` (12 unless given), and the scans
of a folder for the reliability diagram alone. Prints the tables of docs/completers/voxel_unet.md and draws its two
figures. About five minutes on two cores.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pcdbench_completers.heading import RoomFrame
from pcdbench_completers.local_surface import surface_spacing
from pcdbench_completers.voxel_unet.completer import (
    LEAST_LIKELY,
    VOXEL_SPACINGS,
    VoxelUNetCompleter,
    given_what_is_missing,
    unobserved,
)
from pcdbench_completers.voxel_unet.grid import Grid
from pcdbench_completers.voxel_unet.tiles import predict
from pcdbench_tasks.ssim import Ssim
from scipy.spatial import cKDTree

from pcdbench import PointCloud
from pcdbench.case import Case, make_case
from pcdbench.dataset import Dataset
from pcdbench.datasets.clouds import Clouds
from pcdbench.datasets.synthetic import Indoor
from pcdbench.geometry.neighbors import loose_tree
from pcdbench.incompletenesses.holes import Holes
from pcdbench.training.validation import capped_chd

IMAGES = Path(__file__).parent / "images"
THRESHOLDS = (0.1, 0.2, 0.3, 0.4, 0.5)
LEVELS = (0.1, 0.3, 0.5)
BINS = 10
MIN_POINTS = 8000


def cases(dataset: Dataset, names: list[str], level: float) -> list[Case]:
    scenes = [dataset.scene(name) for name in names]
    return [make_case(scene, "holes", Holes(), level, 1) for scene in scenes if len(scene.complete) >= MIN_POINTS]


def threshold_table(measured: dict[float, list[Case]]) -> dict[float, NDArray[np.float64]]:
    """By threshold, (3 levels, 4): medians of ChD over doing nothing, accuracy, completeness and SSIM."""
    table = {}
    for threshold in THRESHOLDS:
        completer = VoxelUNetCompleter(VoxelUNetCompleter.Options(threshold=threshold))
        levels = []
        for level in LEVELS:
            figures = []
            for case in measured[level]:
                complete, given = case.scene.complete.points, case.cloud.points
                cloud = completer.complete(case.cloud, np.random.default_rng(0))
                ssim = Ssim().evaluate(case, cloud, np.random.default_rng(0)).samples["ssim"][0]
                completed = cloud.points
                added, missing = completed[len(given) :], complete[~case.kept]
                floor = capped_chd(given, complete)
                ratio = capped_chd(completed, complete) / floor
                near_m = 1.5 * surface_spacing(complete)
                right = cKDTree(case.scene.dense.points).query(added)[0] < near_m if len(added) else np.ones(1)
                found = cKDTree(completed).query(missing)[0] < near_m
                figures.append((ratio, right.mean(), found.mean(), ssim))
            levels.append(np.median(figures, axis=0))
        table[threshold] = np.array(levels)
        cells = " | ".join(" / ".join(f"{value:.2f}" for value in table[threshold][:, k]) for k in range(4))
        print(f"| {threshold:g} | {cells} |", flush=True)
    return table


def reliability(measured: list[Case]) -> NDArray[np.float64]:
    """(3, BINS): by bin of probability, the sum of probabilities, the number with surface and the number.

    Of what the completer asks its probabilities of: the likeliest of three sub-voxels across the surface, where
    nothing was observed. There is surface if the truth has points in any of the three.
    """
    completer: Any = VoxelUNetCompleter()
    sums = np.zeros((3, BINS))
    for case in measured:
        frame = RoomFrame.of(case.cloud.points)
        cloud = frame.laid(case.cloud)
        spacing_m = surface_spacing(cloud.points)
        grid = Grid.around(cloud.points, VOXEL_SPACINGS * spacing_m)
        found = predict(completer._network, cloud, grid, LEAST_LIKELY)
        found = unobserved(found, loose_tree(cloud.points), grid, spacing_m)
        found = given_what_is_missing(found, cloud, grid)
        dense = frame.laid(case.scene.dense).points
        shape = 2 * np.array(grid.shape)
        occupied = np.zeros(shape, np.bool_)
        occupied.reshape(-1)[grid.cells(dense[grid.holds(dense)], per_edge=2)[0]] = True
        cells = np.stack(np.unravel_index(grid.cells(found.points, per_edge=2)[0], shape), axis=1)
        across = np.eye(3, dtype=int)[found.axis]
        three = [np.clip(cells + step * across, 0, shape - 1) for step in (-1, 0, 1)]
        hit = np.any([occupied[tuple(one.T)] for one in three], axis=0)
        which = np.minimum((found.probability * BINS).astype(int), BINS - 1)
        sums += [np.bincount(which, weight, BINS) for weight in (found.probability, hit, np.ones(len(hit)))]
    return sums


def calibration_error(sums: NDArray[np.float64]) -> float:
    """The expected calibration error of what `reliability` found."""
    return float(np.sum(np.abs(sums[0] - sums[1])) / sums[2].sum())


def means(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, B) of the bins that hold anything: mean probability, share with surface, number."""
    probability, hits, count = sums[:, sums[2] > 0]
    return np.stack([probability / count, hits / count, count])


def cost_table(complete: PointCloud) -> None:
    """Seconds of completing 5,000 to 80,000 points of a room, medians of five."""
    completer = VoxelUNetCompleter()
    for count in (5_000, 10_000, 20_000, 40_000, 80_000):
        rows = np.random.default_rng(0).permutation(len(complete))[:count]
        cloud = complete.select(np.sort(rows))
        seconds = []
        for _ in range(6):
            started = time.perf_counter()
            completer.complete(cloud, np.random.default_rng(0))
            seconds.append(time.perf_counter() - started)
        print(f"| {len(cloud)} | {np.median(seconds[1:]):.3f} | {min(seconds[1:]):.3f} to {max(seconds[1:]):.3f} |")


def draw(table: dict[float, NDArray], diagrams: dict[str, NDArray[np.float64]]) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, level in enumerate(LEVELS):
        left.plot(
            [figures[k, 1] for figures in table.values()],
            [figures[k, 2] for figures in table.values()],
            "o-",
            ms=3,
            label=f"{level:.0%} missing",
        )
    left.set(xlabel="accuracy: added points on the truth", ylabel="completeness: missing points found")
    left.legend(frameon=False)
    right.plot([0, 1], [0, 1], color="gray", linewidth=0.8)
    for name, sums in diagrams.items():
        probability, share, _ = means(sums)
        right.plot(probability, share, "o-", ms=3, label=f"{name} (error {calibration_error(sums):.3f})")
    right.set(xlabel="predicted probability of surface", ylabel="share with surface")
    right.legend(frameon=False)
    figure.savefig(IMAGES / "voxel_unet_confidence.png", dpi=130)


def main(count: str = "12", folder: str = "") -> None:
    data = Indoor()
    names = list(data.scene_names("val"))[: int(count)]
    print("| threshold | ChD over doing nothing at 10 / 30 / 50 % | accuracy | completeness | SSIM |")
    print("|---|---|---|---|---|")
    table = threshold_table({level: cases(data, names, level) for level in LEVELS})
    rooms: dict[str, tuple[Dataset, list[str]]] = {"generated rooms": (data, names)}
    if folder:
        scans = Clouds(Path(folder))
        rooms["real rooms"] = scans, list(scans.scene_names(scans.default_split))
    diagrams = {}
    for name, (dataset, scenes) in rooms.items():
        by_level = {level: reliability(cases(dataset, scenes, level)) for level in LEVELS}
        for level, sums in by_level.items():
            print(f"{name}, {level:.0%} missing: expected calibration error {calibration_error(sums):.3f}")
        diagrams[name] = np.sum(list(by_level.values()), axis=0)
    for name, sums in diagrams.items():
        print(f"\n{name}: expected calibration error {calibration_error(sums):.3f}\n")
        print("| predicted | with surface | sub-voxels |\n|---|---|---|")
        for line in means(sums).T:
            print("| {:.2f} | {:.2f} | {:.0f} |".format(*line))
    print("\n| points | seconds | of five |\n|---|---|---|")
    cost_table(data.scene(names[0]).dense)
    draw(table, diagrams)


if __name__ == "__main__":
    main(*sys.argv[1:])
