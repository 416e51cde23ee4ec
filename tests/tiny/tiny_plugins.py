"""Plugins that the runner's tests install: small, fast, and each misbehaving in a way of its own on request."""

from __future__ import annotations

import ctypes
import io
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

import pcdbench
import pcdbench.formats
from pcdbench import Case, Completer, Dataset, Incompleteness, Measurements, Metric, PointCloud, Scene, Task
from pcdbench.plugins import Register, hookimpl

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@hookimpl
def register_datasets(register: Register) -> None:
    register("tiny", "tiny_plugins:Tiny", "random points in boxes")


@hookimpl
def register_incompletenesses(register: Register) -> None:
    register("slab", "tiny_plugins:Slab", "one side is missing")
    register("troubled_slab", "tiny_plugins:TroubledSlab", "misbehaves by level")


@hookimpl
def register_completers(register: Register) -> None:
    register("tiny_fill", "tiny_plugins:Fill", "random points in the cloud's box")
    register("tiny_colorful", "tiny_plugins:Colorful", "needs colour")
    register("tiny_faulty", "tiny_plugins:Faulty", "fails as its option says")
    register("tiny_troubled", "tiny_plugins:Troubled", "misbehaves by level")
    register("tiny_missing", "tiny_plugins_that_are_not_there:Completer", "cannot be imported")


@hookimpl
def register_tasks(register: Register) -> None:
    register("tiny_gap", "tiny_plugins:Gap", "how far the truth is from the completed cloud")
    register("tiny_color", "tiny_plugins:Color", "mean difference of colour")
    register("tiny_blind", "tiny_plugins:Blind", "looks at nothing")
    register("tiny_trouble", "tiny_plugins:Trouble", "misbehaves by level, once it is asked to measure")
    register("tiny_wrong", "tiny_plugins:Wrong", "measures what is no number")


_hoard: list[np.ndarray] = []


class Unspeakable(Exception):
    def __str__(self) -> str:
        raise RuntimeError("no words")


def misbehave(how: str) -> None:
    """Do one of the things that no plugin should, having said so; `mark:PATH` crashes until the file is there."""
    if how:
        print(f"about to {how}")
    how, _, path = how.partition(":")
    match how:
        case "raise":
            raise ZeroDivisionError("no plane")
        case "exit":
            sys.exit("good bye")
        case "crash":
            ctypes.CDLL(None).puts(b"printed by C")
            ctypes.string_at(0)
        case "vanish":
            os._exit(0)
        case "quit":
            os._exit(7)
        case "linger":
            # Dies between this step and the next.
            threading.Timer(0.3, ctypes.string_at, args=(0,)).start()
        case "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        case "hang":
            time.sleep(600)
        case "freeze":
            # Native code that holds the interpreter: no Python of this process runs any more.
            ctypes.PyDLL(None).sleep(600)
        case "leak":
            while len(_hoard) < 20:
                _hoard.append(np.ones(12_500_000))
            time.sleep(60)
        case "hoard":
            _hoard.append(np.ones(25_000_000))
            time.sleep(0.5)
        case "tally":
            with Path(path).open("a") as stream:
                stream.write("x")
            ctypes.string_at(0)
        case "flood":
            for _ in range(30_000):
                print("x" * 100)
            print("the last line")
            ctypes.string_at(0)
        case "mark":
            if not Path(path).exists():
                Path(path).touch()
                ctypes.string_at(0)
        case "breed":
            child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
            Path(path).write_text(str(child.pid))
            time.sleep(600)
        case "hush":
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.dup2(nowhere, 2)
        case "redirect":
            sys.stdout = sys.stderr = io.StringIO()
        case "shut":
            sys.stdout.close()
            os.close(2)
        case "garble":
            raise Unspeakable
        case "terminate":
            child = multiprocessing.get_context("fork").Process(target=time.sleep, args=(60,))
            child.start()
            child.join(0.3)
            child.terminate()
            child.join()
        case "fork":
            if not os.fork():
                Path(path).write_text(str(os.getpid()))
        case "wander":
            os.chdir(path)
        case "warn":
            warnings.warn("a scan is odd", pcdbench.formats.CloudWarning, stacklevel=1)
            warnings.warn("an interface is old", DeprecationWarning, stacklevel=1)


class Tiny(Dataset):
    """Scenes `box0`, `box1` ...: random points on the sides of boxes."""

    class Options(pcdbench.Options):
        scenes: int = 3
        points: int = 300
        dense: int = 1500
        color: bool = True
        broken: str = Field("", description="a scene that cannot be made, or all")
        seconds: float = Field(0.0, description="how long a scene takes")
        how: str = Field("", description="what the first scene does when it is made")

    options: Options
    default_split = "few"

    def splits(self) -> Sequence[str]:
        return ["few", "none"]

    def scene_names(self, split: str) -> Sequence[str]:
        return [f"box{number}" for number in range(self.options.scenes)] if split == "few" else []

    def digest(self, name: str) -> str:
        return name

    def scene(self, name: str) -> Scene:
        time.sleep(self.options.seconds)
        if name == "box0":
            misbehave(self.options.how)
        if self.options.broken in (name, "all"):
            raise pcdbench.CloudError(f"{name}.ply has no points; scan it again")
        rng = np.random.default_rng(int(name[3:]))
        points = rng.random((self.options.dense, 3)) * (4, 3, 2)
        side = rng.integers(0, 3, self.options.dense)
        points[np.arange(len(points)), side] = 0.0
        dense = PointCloud(points, rng.random(points.shape) if self.options.color else None)
        index = np.sort(rng.permutation(len(points))[: self.options.points])
        return Scene(name, dense.select(index), dense, index)


class Slab(Incompleteness):
    """Takes the points that are furthest in a random direction."""

    def kept(self, scene: Scene, level: float, rng: np.random.Generator) -> np.ndarray:
        along = scene.complete.points @ rng.normal(size=3)
        kept = np.ones(len(along), dtype=bool)
        kept[np.argsort(along)[len(along) - round(level * len(along)) :]] = False
        return kept


class TroubledSlab(Slab):
    class Options(pcdbench.Options):
        how: str = Field("", description="what to do at each tenth of points that are missing, as `crash,hang`")

    options: Options

    def kept(self, scene: Scene, level: float, rng: np.random.Generator) -> np.ndarray:
        misbehave(_at_level(self.options.how, level))
        return super().kept(scene, level, rng)


class Fill(Completer):
    class Options(pcdbench.Options):
        points: int = Field(500, ge=0)
        seconds: float = 0.0

    options: Options

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        time.sleep(self.options.seconds)
        low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
        points = low + rng.random((self.options.points, 3)) * (high - low)
        colors = None if cloud.colors is None else rng.random(points.shape)
        return PointCloud.concatenate([cloud, PointCloud(points, colors)])


class Troubled(Completer):
    class Options(pcdbench.Options):
        how: str = Field("", description="what to do at each tenth of points that are missing, as `crash,hang`")

    options: Options

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        misbehave(_at_level(self.options.how, 1 - len(cloud) / 300))
        return cloud


class Trouble(Task):
    class Options(pcdbench.Options):
        how: str = Field("", description="what to do at each tenth of points that are missing, as `crash,hang`")

    options: Options
    metrics = (Metric("guess", "m", "lower", "a random number", "mean"),)

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        misbehave(_at_level(self.options.how, case.level))
        return Measurements({"guess": rng.random(4)})


def _at_level(how: str, missing: float) -> str:
    number = round(missing * 10) - 1
    each = how.split(",")
    return each[number] if number < len(each) else ""


class Colorful(Completer):
    needs_color = True

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        return cloud


class Posing(PointCloud):
    """A cloud that looks smaller than it is."""

    def __len__(self) -> int:
        return 1


class Faulty(Completer):
    class Options(pcdbench.Options):
        how: Literal[
            "raise", "exit", "crash", "wrong", "empty", "skip", "colorless", "once", "posing", "late", "knows"
        ] = Field("raise", description="how it fails")
        level: float = Field(0.0, description="fails only where more than this share of 300 points is missing")
        mark: str = Field("", description="for `once`: fails until this file exists")

    options: Options

    def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        if len(cloud) > 300 * (1 - self.options.level):
            return cloud
        match self.options.how:
            case "raise":
                raise ZeroDivisionError("no plane\nhas been found")
            case "exit":
                sys.exit("good bye")
            case "crash":
                ctypes.string_at(0)
            case "wrong":
                return cloud.points  # type: ignore[return-value]
            case "empty":
                return PointCloud(np.empty((0, 3)))
            case "skip":
                raise pcdbench.Skipped("only round rooms")
            case "colorless":
                return cloud.without_colors()
            case "posing":
                return Posing(np.repeat(cloud.points, 9, axis=0))
            case "knows":
                return Tiny(None, Tiny.Options()).scene("box0").complete
            case "late":
                late = PointCloud(cloud.points + 0.0)
                late.points.flags.writeable = True
                late.points[0] = np.nan
                return late
            case "once" if not Path(self.options.mark).exists():
                raise RuntimeError("not yet")
        return cloud


class Gap(Task):
    metrics = (
        Metric("gap_m", "m", "lower", "mean distance from the complete to the completed cloud", "mean"),
        Metric("drawn", "share", "higher", "what the rng of the task gave"),
    )

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        from scipy.spatial import cKDTree

        gaps = cKDTree(completed.points).query(case.scene.complete.points)[0]
        return Measurements(
            {"gap_m": [gaps.mean()], "drawn": rng.random(3)},
            labels={"drawn": ["a", "b", "c"]},
            trace={"count": np.int64(len(completed)), "path": np.zeros((2, 3))},
        )

    def figures(self, rows: pd.DataFrame) -> Mapping[str, Figure]:
        from matplotlib.figure import Figure

        figure = Figure()
        axes = figure.subplots()
        for completer, its in rows.groupby("completer"):
            axes.plot(its["level"], [samples["gap_m"][0] for samples in its["samples"]], label=completer)
        return {"by_level": figure}


class Color(Task):
    needs_color = True
    metrics = (Metric("mean_color", "share", "higher", "mean of all colours"),)

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        assert completed.colors is not None
        return Measurements({"mean_color": [float(completed.colors.mean())]})


class Blind(Task):
    metrics = (Metric("guess", "m", "lower", "a random number", "mean"),)

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        return Measurements({"guess": rng.random(4)})


class Wrong(Task):
    class Options(pcdbench.Options):
        how: Literal["nan", "huge", "undeclared", "shape", "text", "none", "trace", "labels"] = "nan"

    options: Options
    metrics = (Metric("value", "m", "lower", "whatever"),)

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        return {
            "nan": Measurements({"value": [1.0, float("nan")]}),
            "huge": Measurements({"value": [1.0, sys.float_info.max]}),
            "undeclared": Measurements({"vaule": [1.0]}),
            "shape": Measurements({"value": 1.0}),  # type: ignore[dict-item]
            "text": Measurements({"value": ["far"]}),  # type: ignore[list-item]
            "none": None,
            "trace": Measurements({"value": [1.0]}, trace={"case": object()}),
            "labels": Measurements({"value": [1.0, 2.0]}, labels={"value": ["a"]}),
        }[self.options.how]  # type: ignore[return-value]
