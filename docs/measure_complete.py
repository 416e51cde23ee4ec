"""Measures `pcdbench complete` at five sizes and draws docs/images/complete_scaling.png.

    python docs/measure_complete.py [COMPLETER [MOST_POINTS [POINTS_A_ROOM]]]

makes buildings of 20,000 to 10,000,000 points (or to MOST_POINTS, for a trial) in a temporary folder, completes each
with the command line in a process of its own, and prints time, processor time and peak memory of each. Without
POINTS_A_ROOM small clouds are thin and large ones dense, as scans are; with it every room has as many points. The
figure is drawn when all sizes were measured. About eight minutes on two cores.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench import PointCloud
from pcdbench.datasets.synthetic import Indoor

# Points, and rooms that have them.
SIZES = {20_000: 1, 100_000: 1, 500_000: 2, 2_000_000: 4, 10_000_000: 9}
GAP_M = 0.5
NOISE_M = 0.004
HOLE_M = 0.5


def rooms(count: int) -> list[PointCloud]:
    """Surveys of generated environments, each with spherical holes that take about a fifth of it."""
    data = Indoor()
    made = []
    for number, name in enumerate(data.scene_names("test-small")[:count]):
        cloud = data.scene(name).dense
        rng = np.random.default_rng(number)
        tree, kept = cKDTree(cloud.points), np.ones(len(cloud), np.bool_)
        while kept.mean() > 0.8:
            kept[tree.query_ball_point(cloud.points[rng.integers(len(cloud))], HOLE_M)] = False
        made.append(cloud.select(kept))
    return made


def building(count: int, points_a_room: int, parts: list[PointCloud]) -> PointCloud:
    """Rooms in rows, every point drawn from a survey and moved by noise; the last room has what is left."""
    rng = np.random.default_rng(count)
    pitch = max(float(np.ptp(part.points, axis=0)[:2].max()) for part in parts) + GAP_M
    points: list[NDArray[np.float64]] = []
    colors: list[NDArray[np.float32]] = []
    columns = int(np.ceil(np.sqrt(count / points_a_room)))
    for number, start in enumerate(range(0, count, points_a_room)):
        part = parts[number % len(parts)]
        assert part.colors is not None
        drawn = min(points_a_room, count - start)
        rows = rng.choice(len(part), drawn, replace=drawn > len(part))
        place = part.points.min(axis=0) - [number % columns * pitch, number // columns * pitch, 0]
        points.append(part.points[rows] - place + rng.normal(0, NOISE_M, (drawn, 3)))
        colors.append(part.colors[rows])
    return PointCloud(np.concatenate(points), np.concatenate(colors))


def measured(scan: Path, out: Path, completer: str) -> tuple[float, float, float, str]:
    """Seconds, processor seconds and peak resident memory (GB) of the command, and its last line."""
    command = [sys.executable, "-m", "pcdbench", "complete", str(scan), "-o", str(out), "--completer", completer]
    start = time.perf_counter()
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    lines = process.stderr.read().splitlines()
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    if status:
        raise SystemExit(f"{' '.join(command)} failed: {lines[-1:]}")
    return seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024 / 1e9, lines[-1]


def draw(
    completer: str, points: NDArray[np.int64], seconds: list[float], busy: list[float], memory: list[float]
) -> None:
    """Draw docs/images/complete_scaling.png."""
    figure = Figure(figsize=(9.5, 3.8), layout="constrained", dpi=120)
    time_axes, memory_axes = figure.subplots(1, 2)
    time_axes.loglog(points, seconds, "o-", label="wall clock")
    time_axes.loglog(points, busy, "s-", label="processor")
    time_axes.loglog(points, busy[1] * points / points[1], "--", color="grey", label="linear")
    time_axes.set(xlabel="observed points", ylabel="seconds", title=f"time, {completer}")
    time_axes.legend()
    memory_axes.semilogx(points, memory, "o-")
    memory_axes.set(xlabel="observed points", ylabel="GB", title="peak resident memory")
    memory_axes.set_ylim(bottom=0)
    path = Path(__file__).parent / "images" / "complete_scaling.png"
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path)


def main(completer: str = "plane_fitting", most_points: str = "", points_a_room: str = "") -> None:
    sizes = {size: count for size, count in SIZES.items() if size <= int(most_points or max(SIZES))}
    parts = rooms(max(sizes.values()))
    seconds, busy, memory = [], [], []
    print("| points | rooms | added | seconds | processor seconds | memory, GB |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for size, count in sizes.items():
            scan, out = Path(folder) / "scan.ply", Path(folder) / "out.ply"
            of_room = int(points_a_room or size // count)
            building(size, of_room, parts).write(scan)
            took, processor, peak, line = measured(scan, out, completer)
            seconds.append(took)
            busy.append(processor)
            memory.append(peak)
            added = line.split(" observed, ")[1].split(" added")[0]
            print(
                f"| {size:,} | {size / of_room:g} | {added} | {took:.0f} | {processor:.0f} | {peak:.2f} |", flush=True
            )
    if len(sizes) < len(SIZES):
        return
    draw(completer, np.array(list(sizes)), seconds, busy, memory)


if __name__ == "__main__":
    main(*sys.argv[1:])
