"""The data set `clouds`: a scan, or a folder of scans, on disk."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from pcdbench import options
from pcdbench.cloud import PointCloud
from pcdbench.dataset import Dataset
from pcdbench.datasets.boxes import boxes_file, read_boxes
from pcdbench.datasets.scans import (
    FEWEST_POINTS,
    absolute_root,
    content_digest,
    folders_under,
    scene_names,
    scene_of_scan,
    without_duplicates,
)
from pcdbench.errors import PcdbenchError
from pcdbench.formats import EXTENSIONS, read_observed
from pcdbench.formats.text import holds_points
from pcdbench.keys import digest, seed_from
from pcdbench.scene import Scene, TaggedObject

# Folders of scans hold notes and tables under these extensions too.
_NOTES_EXTENSIONS = (".txt", ".csv")


class Clouds(Dataset):
    """The clouds of one file, or of a folder and its subfolders; a cloud is a scene.

    Points are kept where the file has them: a scan in map coordinates gives a scene in map coordinates.
    """

    class Options(options.Options):
        complete_points: int = Field(
            20_000, ge=FEWEST_POINTS, description="points of the complete cloud (all of the file's where it has fewer)"
        )
        draws: int = Field(1, ge=1, description="cases, each of another seed, of a scene at each level")
        complete: str = Field(
            "",
            description="real pairs: the file name of a complete scan (full.ply); each other cloud in its folder is "
            "then a scene, an incomplete scan of the same place",
        )
        partials: str = Field("*", description="real pairs: which files are incomplete scans (sub_*.ply)")

        @field_validator("complete")
        @classmethod
        def _is_a_name(cls, complete: str) -> str:
            if complete != Path(complete).name:
                raise ValueError(f"{complete!r} is no name of a file (full.ply), but a path; give the name alone")
            return complete

        @field_validator("partials")
        @classmethod
        def _is_a_pattern(cls, partials: str) -> str:
            if not Path(partials).parts:
                raise ValueError(f"{partials!r} fits no name; give a pattern (sub_*.ply), or * for all other clouds")
            return partials

        @model_validator(mode="after")
        def _pairs_are_asked_for(self) -> Self:
            if not self.complete and options.changed(self, "partials"):
                raise ValueError("partials would have no effect without the complete scan; add complete=FILE")
            return self

    options: Options
    default_split = "all"

    def splits(self) -> Sequence[str]:
        """One split: `all`."""
        return ("all",)

    def scene_names(self, split: str) -> Sequence[str]:
        """The files, by name, in the order of their paths.

        Raises:
            PcdbenchError: for another split than `all`, or where the path holds no cloud.
        """
        if split != "all":
            raise PcdbenchError(f"data set clouds has one split, all; there is no {split!r}")
        return tuple(self._files)

    def draws(self, split: str) -> int:
        """How many cases a scene gives at each level: the option `draws`."""
        return self.options.draws

    def environment(self, name: str) -> str:
        """The complete scan of a real pair, which its folder's other pairs have too; else the cloud itself."""
        path = self._file(name)
        if not self.options.complete:
            return name
        assert self.path is not None
        return Path(os.path.relpath(self._complete_of(path), absolute_root("clouds", self.path))).as_posix()

    def scene(self, name: str) -> Scene:
        """Read one cloud, or the two of a real pair; the sample is seeded by the file's content.

        Raises:
            CloudError: where a file cannot be read or its cloud is too small to be measured.
        """
        path = self._file(name)
        complete = self._complete_of(path)
        boxes = boxes_file(complete)
        cloud = read_observed(complete)[0]
        return scene_of_scan(
            name,
            cloud,
            complete,
            self.options.complete_points,
            seed_from("clouds", content_digest(complete)),
            objects=() if boxes is None else self._objects(boxes, complete, cloud),
            partial=without_duplicates(read_observed(path)[0]) if self.options.complete else None,
            info={"incomplete scan": path.name} if self.options.complete else None,
        )

    def digest(self, name: str) -> str:
        """Digest of the scene's name and the bytes of its files: the cloud's, its boxes', and a pair's other cloud.

        With the name, so that two copies of a file are two scenes.
        """
        path = self._file(name)
        complete = self._complete_of(path)
        boxes = boxes_file(complete)
        parts = [name, content_digest(complete), None if boxes is None else content_digest(boxes)]
        return digest([*parts, content_digest(path)] if self.options.complete else parts)

    def _objects(self, boxes: Path, complete: Path, cloud: PointCloud) -> tuple[TaggedObject, ...]:
        is_only_cloud = len(self._clouds_in(complete.parent)) == 1
        return read_boxes(boxes, complete, is_only_cloud, float(np.ptp(cloud.points, axis=0).max()))

    def _complete_of(self, path: Path) -> Path:
        """The complete scan of a scene's file: itself, or the other file of its pair."""
        return path.with_name(self.options.complete) if self.options.complete else path

    def _file(self, name: str) -> Path:
        if name not in self._files:
            raise PcdbenchError(f"data set clouds:{self.path} has no scene {name!r}; pcdbench run names those it has")
        return self._files[name]

    @cached_property
    def _files(self) -> Mapping[str, Path]:
        """Each scene's file, by the scene's name."""
        if self.path is None:
            raise PcdbenchError("data set clouds needs a file or folder: --dataset clouds:PATH")
        root = absolute_root("clouds", self.path)
        if not root.exists():
            raise PcdbenchError(f"clouds:{root}: there is no such file or folder; check the path")
        if not root.is_dir():
            return {scene_names([root.stem])[0]: root}
        paths = _cloud_paths(root)
        if not paths:
            raise PcdbenchError(f"{root} holds no cloud; put files of these formats there: {' '.join(EXTENSIONS)}")
        if self.options.complete:
            paths = self._partial_scans(paths, root)
        inside = [path.relative_to(root) for path in paths]
        names = scene_names(
            ["-".join(path.with_suffix("").parts) for path in inside], ["-".join(path.parts) for path in inside]
        )
        return dict(zip(names, paths, strict=True))

    def _partial_scans(self, paths: Sequence[Path], root: Path) -> list[Path]:
        """Those of the clouds that are incomplete scans beside a complete one."""
        complete = self.options.complete
        folders = {path.parent for path in paths if path.name == complete}
        found = [
            path
            for path in paths
            if path.parent in folders and path.name != complete and path.match(self.options.partials)
        ]
        if not found:
            raise PcdbenchError(
                f"{root} holds no {complete} with clouds {self.options.partials} beside it; check clouds.complete and "
                "clouds.partials"
            )
        return found

    @staticmethod
    def _clouds_in(folder: Path) -> list[Path]:
        return [path for path in folder.iterdir() if _is_cloud(path) and not path.name.startswith(".")]


def _cloud_paths(root: Path) -> list[Path]:
    """All clouds under `root`, sorted; hidden files and folders are passed over."""
    found = [folder / name for folder, _, names in folders_under(root) for name in names if not name.startswith(".")]
    return sorted(path for path in found if _is_cloud(path))


def _is_cloud(path: Path) -> bool:
    """Whether a folder's file is taken for a cloud: by its extension, and .txt and .csv by their first rows too."""
    extension = path.suffix.lower()
    return extension in EXTENSIONS and (extension not in _NOTES_EXTENSIONS or holds_points(path))
