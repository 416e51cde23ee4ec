"""The data set `indoor`: fifty generated environments, five surveyed crops each, and endless ones to train on."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import Field

from pcdbench import options
from pcdbench.dataset import Dataset
from pcdbench.datasets.synthetic.crops import COMPLETE_POINTS, crop_of
from pcdbench.datasets.synthetic.generator import SEEDS, VERSION, environment
from pcdbench.datasets.synthetic.storage import (
    arrays_of_scene,
    arrays_of_surface,
    scene_of_arrays,
    surface_of_arrays,
)
from pcdbench.errors import PcdbenchError
from pcdbench.files import read_arrays, write_arrays
from pcdbench.geometry.sampling import own_numbers, poisson_disk_indices
from pcdbench.keys import digest, seed_from
from pcdbench.paths import cache_dir
from pcdbench.plugins import did_you_mean
from pcdbench.scene import Scene, Surface

CROPS = 5
TEST = range(0, 30)
VALIDATION = range(30, 48)
SMOKE = range(48, 50)

_NAME = re.compile(r"(?P<stream>env|train)(?P<index>\d{3}|\d{6})_crop(?P<crop>[0-4])")


class Indoor(Dataset):
    """Generated indoor environments, scanned as a survey would scan them; the same rooms on every machine.

    Environments with even numbers are large (corridors, hallways, lobbies, open-plan floors), those with odd
    numbers small (offices, meeting rooms, classrooms, kitchens, lounges, store rooms). Splits never share one.
    """

    class Options(options.Options):
        complete_points: int = Field(
            COMPLETE_POINTS, ge=1000, le=50_000, description="points of a complete cloud, out of the dense one"
        )

    options: Options
    version = VERSION
    default_split = "smoke"

    def splits(self) -> Sequence[str]:
        """`test` (publication's size), `test-small`, `smoke`, `val`, and `train`, which is endless."""
        return ("test", "test-small", "smoke", "val", "train")

    def scene_names(self, split: str) -> Sequence[str]:
        """The scenes of a split.

        Raises:
            PcdbenchError: for an unknown split, and for `train`, whose scenes cannot be listed.
        """
        if split == "test":
            return [_name(index, crop) for index in TEST for crop in range(CROPS)]
        firsts = {"test-small": TEST, "smoke": SMOKE, "val": VALIDATION}
        if split in firsts:
            return [_name(index, 0) for index in firsts[split]]
        if split == "train":
            raise PcdbenchError(
                "split train of indoor is endless and cannot be listed; draw from it with "
                "Indoor().training_scene(0), training_scene(1) and so on"
            )
        raise PcdbenchError(f"indoor has no split {split!r}; {did_you_mean(split, self.splits())}")

    def draws(self, split: str) -> int:
        """Two in `test`: 150 crops make 300 cases at each level."""
        return 2 if split == "test" else 1

    def environment(self, name: str) -> str:
        """That which the crop is cut from: crops of one environment overlap."""
        return name.partition("_")[0]

    def digest(self, name: str) -> str:
        """The generator's version and the name decide a scene."""
        return digest({"generator": VERSION, "name": name})

    def scene(self, name: str) -> Scene:
        """Make a scene, or read it from the cache; training scenes are not cached.

        Raises:
            PcdbenchError: where no scene has that name.
        """
        found = _NAME.fullmatch(name)
        known = found is not None and len(found["index"]) == (3 if found["stream"] == "env" else 6)
        if found is None or not known or (found["stream"] == "env" and int(found["index"]) >= SMOKE.stop):
            names = [*self.scene_names("test"), *self.scene_names("val"), *self.scene_names("smoke")]
            raise PcdbenchError(f"indoor has no scene {name!r}; {did_you_mean(name, names)}")
        index, crop = int(found["index"]), int(found["crop"])
        made = _made(name, "train", index, crop) if found["stream"] == "train" else _cached(name, index, crop)
        return _with_complete_points(made, self.options.complete_points)

    def training_scene(self, index: int) -> Scene:
        """Scene `index` (0 and up) of the endless training split; five in a row share an environment.

        Raises:
            PcdbenchError: for a negative index.
        """
        if not 0 <= index < CROPS * 10**6:
            raise PcdbenchError(f"training scenes of indoor are numbered from 0 to {CROPS * 10**6 - 1}, not {index}")
        return self.scene(f"train{index // CROPS:06d}_crop{index % CROPS}")


def _name(index: int, crop: int) -> str:
    return f"env{index:03d}_crop{crop}"


def _cached(name: str, index: int, crop: int) -> Scene:
    """A benchmark scene, from the cache where it is there."""
    scene_file, surface_file = (_cache_file(stem) for stem in (name, f"env{index:03d}"))
    arrays, mesh = read_arrays(scene_file), read_arrays(surface_file)
    if arrays is not None and mesh is not None:
        try:
            return scene_of_arrays(name, arrays, surface_of_arrays(mesh))
        except KeyError:
            pass  # A file of something else under this name: made again below, like a broken one.
    made = _made(name, "benchmark", index, crop)
    assert made.surface is not None
    if mesh is None or arrays is not None:
        write_arrays(surface_file, arrays_of_surface(made.surface))
    write_arrays(scene_file, arrays_of_scene(made))
    return made


def _with_complete_points(scene: Scene, count: int) -> Scene:
    """The scene with a complete cloud of so many points."""
    if count == COMPLETE_POINTS:
        return scene
    order = np.argsort(own_numbers(scene.dense.points), kind="stable")
    index = poisson_disk_indices(scene.dense.points, count, order=order)
    return replace(scene, complete=scene.dense.select(index), complete_index=index)


def _cache_file(stem: str) -> Path:
    return cache_dir() / "indoor" / VERSION / f"{stem}.npz"


def _made(name: str, stream: str, index: int, crop: int) -> Scene:
    """Survey a crop of an environment."""
    place = environment(index, stream)
    made = crop_of(place, np.random.default_rng(seed_from("indoor", SEEDS, stream, index, "crop", crop)))
    opaque = np.zeros(len(place.mesh.triangles), np.bool_)
    opaque[place.opaque] = True
    extent = " x ".join(f"{side:.1f}" for side in np.ptp(made.dense.points, axis=0))
    return Scene(
        name=name,
        complete=made.dense.select(made.complete_index),
        dense=made.dense,
        complete_index=made.complete_index,
        objects=made.objects,
        surface=Surface(place.mesh.vertices, place.mesh.triangles, ~opaque),
        source=f"generated: indoor version {VERSION}, environment {place.name}, crop {crop}",
        info={"kind": place.kind, "survey": made.survey, "extent_m": extent},
    )
