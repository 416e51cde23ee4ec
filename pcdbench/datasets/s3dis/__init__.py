"""The data set `s3dis`: the Stanford rooms in their original release, defects and all."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from pydantic import Field

from pcdbench import options
from pcdbench.cloud import PointCloud
from pcdbench.dataset import Dataset, Finding
from pcdbench.datasets.s3dis.room import STRUCTURE, Room, read_room, room_files
from pcdbench.datasets.scans import FEWEST_POINTS, absolute_root, folder_digest, scene_names, scene_of_scan
from pcdbench.errors import PcdbenchError
from pcdbench.files import read_arrays, write_arrays
from pcdbench.keys import digest, seed_from
from pcdbench.paths import cache_dir
from pcdbench.plugins import did_you_mean
from pcdbench.scene import Box, Scene, TaggedObject

# Raise it whenever reading gives something else, so that rooms cached before are read again.
_READER = 2
# Points are kept relative to the multiple of this nearest to their mean: at map coordinates single precision would
# crush them, and near the origin, where the release's rooms are, they are kept as they are.
_CENTER_STEP_M = 256.0
_AREA = re.compile(r"Area_(\w+)", re.IGNORECASE)


class S3DIS(Dataset):
    """Stanford Large-Scale 3D Indoor Spaces: `Area_N/room/room.txt` with `Annotations/*.txt`.

    A room is a scene; each annotated instance is a tagged object with its axis-aligned box. Known defects are mended
    and told by `pcdbench data check s3dis:PATH`. Rooms are read once and cached. Armeni et al., CVPR 2016.
    """

    class Options(options.Options):
        complete_points: int = Field(
            20_000, ge=FEWEST_POINTS, description="points of the complete cloud (all of the room's where it has fewer)"
        )
        draws: int = Field(1, ge=1, description="cases, each of another seed, of a scene at each level")
        structure: bool = Field(
            False, description=f"tag what nobody would look for on a map, too: {', '.join(sorted(STRUCTURE))}"
        )

    options: Options
    default_split = "all"

    def splits(self) -> Sequence[str]:
        """`all`, and each area that is there: `area1` to `area6`."""
        return ("all", *self._areas)

    def scene_names(self, split: str) -> Sequence[str]:
        """The rooms of an area, or of all, by name.

        Raises:
            PcdbenchError: for a split that is not there, or where the path holds no area.
        """
        if split not in self.splits():
            raise PcdbenchError(f"s3dis:{self.path} has no split {split!r}; {did_you_mean(split, self.splits())}")
        return [name for area, rooms in self._areas.items() if split in ("all", area) for name in rooms]

    def draws(self, split: str) -> int:
        """How many cases a scene gives at each level: the option `draws`."""
        return self.options.draws

    def scene(self, name: str) -> Scene:
        """Read one room, from the cache where it was read before.

        Raises:
            CloudError: where no point of it can be read, or it is too small to be measured.
        """
        room = self._room(name)
        return scene_of_scan(
            name,
            room.cloud,
            self._folder(name),
            self.options.complete_points,
            seed_from("s3dis", self.digest(name)),
            objects=tuple(tagged for tagged in room.objects if self.options.structure or tagged.label not in STRUCTURE),
        )

    def digest(self, name: str) -> str:
        """Digest of the room's name and the bytes of its files."""
        folder = self._folder(name)
        return digest([name, folder_digest(folder, room_files(folder))])

    def check(self, name: str) -> Sequence[Finding]:
        """The defects of a room, file by file, and how they were mended."""
        try:
            room = self._room(name)
        except PcdbenchError as error:
            return [Finding(name, str(error), usable=False)]
        return [*room.findings, *super().check(name)]

    def _room(self, name: str) -> Room:
        folder = self._folder(name)
        path = cache_dir() / "s3dis" / f"{digest([_READER, self.digest(name)])}.npz"
        arrays = read_arrays(path)
        if arrays is None:
            arrays = _arrays_of(read_room(folder))
            write_arrays(path, arrays)
        # Always in the precision of what is stored, so that the first time gives what every later time gives.
        return _room_of(arrays)

    def _folder(self, name: str) -> Path:
        found = {name: folder for rooms in self._areas.values() for name, folder in rooms.items()}
        if name not in found:
            raise PcdbenchError(f"s3dis:{self.path} has no room {name!r}; {did_you_mean(name, list(found))}")
        return found[name]

    @cached_property
    def _areas(self) -> Mapping[str, Mapping[str, Path]]:
        """By split, the folder of each room by its scene's name."""
        if self.path is None:
            raise PcdbenchError("data set s3dis needs the folder that holds Area_1 to Area_6: --dataset s3dis:PATH")
        root = absolute_root("s3dis", self.path)
        if not root.is_dir():
            raise PcdbenchError(f"s3dis:{root}: there is no such folder; check the path")
        found = _area_folders(root)
        if not found:
            raise PcdbenchError(
                f"{root} holds no Area_N folder; give the unpacked Stanford3dDataset_v1.2 (text files, not a .zip)"
            )
        areas = {}
        for area, folders in found.items():
            rooms = [room for folder in folders for room in sorted(_subfolders(folder))]
            areas[area] = dict(zip(scene_names([f"{area}-{room.name}" for room in rooms]), rooms, strict=True))
        return areas


def _area_folders(root: Path) -> dict[str, list[Path]]:
    """Split name and folders of each area: `root` itself, those in it, or those in the first subfolder that has some.

    Two folders of one area differ in capitals alone.
    """
    inside = sorted(_subfolders(root))
    for candidates in ([root], inside, *(sorted(_subfolders(folder)) for folder in inside)):
        found: dict[str, list[Path]] = {}
        for folder in candidates:
            if match := _AREA.fullmatch(folder.name):
                found.setdefault(f"area{match[1].lower()}", []).append(folder)
        if found:
            return found
    return {}


def _subfolders(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if path.is_dir() and not path.name.startswith(".")]


def _arrays_of(room: Room) -> dict[str, np.ndarray]:
    """A room for an NPZ file: points about a near centre in single precision, colours in 8 bits."""
    center = np.round(room.cloud.points.mean(axis=0) / _CENTER_STEP_M) * _CENTER_STEP_M
    boxes = [[*tagged.box.center, *tagged.box.size] for tagged in room.objects]
    arrays = {
        "center": center,
        "points": (room.cloud.points - center).astype(np.float32),
        "labels": np.array([tagged.label for tagged in room.objects], dtype=np.str_),
        "boxes": np.array(boxes, np.float64).reshape(-1, 6),
        "findings": np.array(json.dumps([[its.where, its.problem, its.done] for its in room.findings])),
    }
    if room.cloud.colors is not None:
        arrays["colors"] = np.rint(room.cloud.colors * 255).astype(np.uint8)
    return arrays


def _room_of(arrays: Mapping[str, np.ndarray]) -> Room:
    colors = arrays["colors"].astype(np.float32) / np.float32(255) if "colors" in arrays else None
    objects = tuple(
        TaggedObject(str(label), Box(row[:3], row[3:]))
        for label, row in zip(arrays["labels"], arrays["boxes"], strict=True)
    )
    findings = tuple(Finding(*its) for its in json.loads(str(arrays["findings"])))
    return Room(PointCloud(arrays["points"].astype(np.float64) + arrays["center"], colors), objects, findings)
