"""Measures DeepPCD: a training step and where its time goes, and completing a cloud of 20,000 points.

    python docs/measure_deeppcd.py

prints, for as many threads as this process may use (`PCDBENCH_THREADS`), the seconds of a sample's forward pass, loss
and backward pass, of preparing an example, and of completing with and without colour; each the median of a few, with
the processor time. Networks are untrained: their weights decide no time. Half a minute on two idle cores.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
import torch
from pcdbench_completers.deeppcd.color import PaintingNetwork
from pcdbench_completers.deeppcd.completer import DeepPCD, DeepPCDOptions
from pcdbench_completers.deeppcd.inference import completed, painted
from pcdbench_completers.deeppcd.neighborhoods import Neighborhoods
from pcdbench_completers.deeppcd.network import DeepPCDNetwork
from pcdbench_completers.deeppcd.trainee import DeepPCDTrainee
from pcdbench_completers.patches import Patches

from pcdbench import PointCloud
from pcdbench.incompletenesses.holes import Holes
from pcdbench.testing import small_room
from pcdbench.threads import thread_count
from pcdbench.training.precision import bfloat16_pays
from pcdbench.training.stream import TrainingPair

POINTS = 20_000
REPEATS = 7


def measured(what: str, work: Callable[[], object]) -> None:
    """Print the median wall and processor time of the work, after a warm-up."""
    work()
    wall, processor = [], []
    for _ in range(REPEATS):
        began, busy = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - began)
        processor.append(time.process_time() - busy)
    print(f"{what:<58}{statistics.median(wall):8.3f} s {statistics.median(processor):8.3f} s", flush=True)


def matrix_product() -> None:
    """What the processor can do at best: 100 GFLOP, about what a sample's forward and backward pass take."""
    a, b = torch.ones(25_600, 1024), torch.ones(1024, 1900)
    a @ b


def training(room: PointCloud, kept: np.ndarray) -> None:
    """A sample's way through training."""
    trainee, rng = DeepPCDTrainee(), np.random.default_rng(0)
    pair = TrainingPair(room, room, kept)
    measured("training: preparing an example (loader workers do it)", lambda: trainee.example(pair, rng))
    example = {name: torch.as_tensor(value) for name, value in trainee.example(pair, rng).items()}
    network = trainee.network()

    def loss() -> torch.Tensor:
        with torch.autocast("cpu", torch.bfloat16, enabled=bfloat16_pays()):
            return trainee.loss(network, example)["loss"]

    def step() -> None:
        network.zero_grad()
        loss().backward()

    measured("training: forward and loss", loss)
    measured("training: forward, loss and backward", step)


def completing(cloud: PointCloud) -> None:
    """A cloud's way through the completer."""
    torch.manual_seed(0)
    network, painting = DeepPCDNetwork().eval(), PaintingNetwork().eval()
    rng = np.random.default_rng(0)
    completer = DeepPCD(DeepPCDOptions(), network, painting)
    measured("completing: geometry alone", lambda: completer.complete(cloud.without_colors(), rng))
    measured("completing: with colour", lambda: completer.complete(cloud, rng))
    patches = Patches.of(cloud.points, 5, rng)
    assert patches is not None and cloud.colors is not None
    around = Neighborhoods.of(patches.points)
    scaled = completed(network, patches, around)
    third = np.arange(len(scaled)) % 3 == 0
    colors = cloud.colors
    measured("  cutting patches", lambda: Patches.of(cloud.points, 5, rng))
    measured("  sampling and neighbours", lambda: Neighborhoods.of(patches.points))
    measured("  the geometry network", lambda: completed(network, patches, around))
    measured(
        "  the colour network, a third of the points", lambda: painted(painting, patches, around, colors, scaled, third)
    )


def main() -> None:
    threads = thread_count()
    torch.set_num_threads(threads)
    precision = "bfloat16" if bfloat16_pays() else "float32"
    print(f"{threads} threads, {precision}; median of {REPEATS}{'wall':>29}{'processor':>12}")
    measured("100 GFLOP of a float32 matrix product", matrix_product)
    scene = small_room(POINTS)
    training(scene.complete, Holes().kept(scene, 0.3, np.random.default_rng(0)))
    completing(scene.complete)


if __name__ == "__main__":
    main()
