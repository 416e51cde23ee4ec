"""Plugins that write down how often they are made, and by which process."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import pcdbench
from pcdbench import Case, Completer, Dataset, Measurements, Metric, PointCloud, Scene, Task
from pcdbench.plugins import Register, hookimpl


@hookimpl
def register_datasets(register: Register) -> None:
    register("counted_rooms", "counted_plugins:Rooms", "random points")


@hookimpl
def register_completers(register: Register) -> None:
    register("counted_nothing", "counted_plugins:Nothing", "does nothing, for a while")


@hookimpl
def register_tasks(register: Register) -> None:
    register("counted_size", "counted_plugins:Size", "how many points there are")


def _write_down(log: str, what: str) -> None:
    if log:
        with Path(log).open("a") as stream:
            stream.write(f"{what} {os.getpid()}\n")


class Rooms(Dataset):
    class Options(pcdbench.Options):
        log: str = ""
        scenes: int = 4

    options: Options
    default_split = "all"

    def splits(self) -> Sequence[str]:
        return ["all"]

    def scene_names(self, split: str) -> Sequence[str]:
        return [f"room{number}" for number in range(self.options.scenes)]

    def digest(self, name: str) -> str:
        return name

    def scene(self, name: str) -> Scene:
        _write_down(self.options.log, name)
        cloud = PointCloud(np.random.default_rng(int(name[4:])).random((300, 3)))
        return Scene(name, cloud, cloud, np.arange(300))


class Nothing(Completer):
    class Options(pcdbench.Options):
        log: str = ""
        seconds: float = 0.0

    options: Options

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        _write_down(self.options.log, "completer")

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        time.sleep(self.options.seconds)
        return cloud


class Size(Task):
    metrics = (Metric("size", "points", "higher", "points of the completed cloud", "mean"),)

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        return Measurements({"size": [len(completed)]})
