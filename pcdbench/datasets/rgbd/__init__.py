"""The data set `rgbd`: posed colour and depth images, fused into scenes."""

from __future__ import annotations

import json
import os
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pcdbench import options
from pcdbench.cloud import PointCloud
from pcdbench.dataset import Dataset, Finding
from pcdbench.datasets.rgbd import sequence as posed
from pcdbench.datasets.rgbd.fusion import Fused, Settings, fused
from pcdbench.datasets.rgbd.gravity import T_zup, up_direction
from pcdbench.datasets.rgbd.layouts import LAYOUTS, layout_of, read_sequence
from pcdbench.datasets.scans import (
    FEWEST_POINTS,
    absolute_root,
    folder_digest,
    folders_under,
    scene_names,
    scene_of_scan,
)
from pcdbench.errors import PcdbenchError
from pcdbench.files import read_arrays, write_arrays
from pcdbench.formats import CloudWarning
from pcdbench.geometry.poses import Pose, transform
from pcdbench.keys import digest, seed_from
from pcdbench.paths import cache_dir
from pcdbench.plugins import did_you_mean
from pcdbench.scene import Scene

# Raise it whenever fusing gives something else, so that what was fused before is fused again.
_FUSION = 4
# Median depths beyond these are of no room: the depth scale is wrong.
_NEAREST_M, _FARTHEST_M = 0.2, 20.0
_AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
_PARTS = re.compile(r"(?P<sequence>.+)_frames(?P<first>\d+)-(?P<last>\d+)")


class Rgbd(Dataset):
    """Posed RGB-D in the layouts of 7-Scenes, TUM RGB-D, ScanNet (exported) and RTAB-Map; a sequence is a scene.

    Frames are fused by a truncated signed distance field (Curless and Levoy 1996; Open3D's VoxelBlockGrid), the cloud
    turned upright, its floor at height 0. With `partial_frames` each run of that many frames is a real pair with the
    whole. Frames that cannot be used are skipped; `pcdbench data check rgbd:PATH` says how many, and why.
    """

    class Options(options.Options):
        complete_points: int = Field(
            20_000, ge=FEWEST_POINTS, description="points of the complete cloud (all of the fused ones where fewer)"
        )
        draws: int = Field(1, ge=1, description="cases, each of another seed, of a scene at each level")
        voxel_m: float = Field(0.0125, gt=0, description="voxel edge, metres")
        truncation_voxels: float = Field(4.0, ge=1, description="voxels kept on either side of a surface")
        depth_max_m: float = Field(4.0, gt=0, description="depth beyond this is left out, metres")
        min_weight: float = Field(3.0, ge=0, description="frames that must have seen a point")
        every: int = Field(1, ge=1, description="take each n-th frame")
        up: Literal["auto", "x", "y", "z", "-x", "-y", "-z"] = Field(
            "auto", description="the world's up; auto: what a calibration file says, else found from the planes"
        )
        partial_frames: int = Field(
            0, ge=0, description="real pairs: frames of an incomplete scan, one after the other; 0: no pairs"
        )

    options: Options
    version = "2"
    default_split = "all"

    def splits(self) -> Sequence[str]:
        """One split: `all`."""
        return ("all",)

    def scene_names(self, split: str) -> Sequence[str]:
        """The sequences, or, with `partial_frames`, the runs of frames of each.

        Raises:
            PcdbenchError: for another split than `all`, or where the path holds no sequence.
        """
        if split != "all":
            raise PcdbenchError(f"data set rgbd has one split, all; there is no {split!r}")
        if not self.options.partial_frames:
            return tuple(self._folders)
        names = [
            f"{name}_frames{first}-{first + self.options.partial_frames - 1}"
            for name in self._folders
            for first in range(0, len(self._sequence(name).frames), self.options.partial_frames)
            if first + self.options.partial_frames <= len(self._sequence(name).frames)
        ]
        if not names:
            raise PcdbenchError(f"no sequence of rgbd:{self.path} has {self.options.partial_frames} frames")
        return names

    def draws(self, split: str) -> int:
        """How many cases a scene gives at each level: the option `draws`."""
        return self.options.draws

    def environment(self, name: str) -> str:
        """The sequence, which all of its real pairs have as their complete scan."""
        return self._parts(name)[0]

    def scene(self, name: str) -> Scene:
        """Fuse a sequence, or take it from the cache where it was fused before.

        Raises:
            CloudError: where no frame can be used, or the cloud is too small to be measured.
        """
        folder_name, frames = self._parts(name)
        whole = self._fused(folder_name, None)
        sequence = self._sequence(folder_name)
        _warn_of_skipped(sequence, whole)
        T = self._T_zup_world(sequence, whole)
        partial = None
        if frames is not None:
            seen = self._fused(folder_name, frames).cloud
            partial = PointCloud(transform(T, seen.points), seen.colors)
        return scene_of_scan(
            name,
            PointCloud(transform(T, whole.cloud.points), whole.cloud.colors),
            self._folders[folder_name],
            self.options.complete_points,
            seed_from("rgbd", self._digest_of(folder_name)),
            partial=partial,
            viewpoints=transform(T, whole.T_world_depth[:, :3, 3]),
            info={"frames": f"{len(whole.T_world_depth)}"},
        )

    def digest(self, name: str) -> str:
        """Digest of the scene's name, of all files that its frames come from, and of a camera that a name tells."""
        folder_name, _ = self._parts(name)
        return digest([name, self._digest_of(folder_name)])

    def check(self, name: str) -> Sequence[Finding]:
        """The frames that cannot be used, by reason, and whatever else is odd."""
        findings = list(super().check(name))
        try:
            folder_name, _ = self._parts(name)
            layout = layout_of(self._folders[folder_name])
        except PcdbenchError:
            return findings
        return [replace(its, where=f"{name} ({layout})") for its in findings]

    def _parts(self, name: str) -> tuple[str, tuple[int, int] | None]:
        """The sequence of a scene and, of a real pair, its first frame and the one after its last."""
        match = _PARTS.fullmatch(name) if self.options.partial_frames else None
        folder_name = match["sequence"] if match else name
        if folder_name not in self._folders:
            raise PcdbenchError(
                f"data set rgbd:{self.path} has no scene {name!r}; {did_you_mean(folder_name, list(self._folders))}"
            )
        return folder_name, (int(match["first"]), int(match["last"]) + 1) if match else None

    def _fused(self, folder_name: str, frames: tuple[int, int] | None) -> Fused:
        settings = Settings(
            self.options.voxel_m, self.options.truncation_voxels, self.options.depth_max_m, self.options.min_weight
        )
        key = digest([_FUSION, self._digest_of(folder_name), self.options.every, frames, vars(settings)])
        path = cache_dir() / "rgbd" / f"{key}.npz"
        arrays = read_arrays(path)
        if arrays is None:
            sequence = self._sequence(folder_name)
            if frames is not None:
                sequence = replace(sequence, frames=sequence.frames[slice(*frames)], unusable=None)
            arrays = _arrays_of(fused(sequence, settings))
            write_arrays(path, arrays)
        # Always in the precision of what is stored, so that the first time gives what every later time gives.
        return _fused_of(arrays)

    def _T_zup_world(self, sequence: posed.Sequence, whole: Fused) -> Pose:
        """What turns the poses' world upright: the option, the calibration, or the planes of the scan."""
        if self.options.up != "auto":
            sign = -1.0 if self.options.up.startswith("-") else 1.0
            return T_zup(whole.cloud.points, sign * np.array(_AXES[self.options.up[-1]], np.float64))
        if sequence.T_zup_world is not None:
            return sequence.T_zup_world
        likely = -whole.T_world_depth[:, :3, 1].mean(axis=0)
        return T_zup(whole.cloud.points, up_direction(whole.normals, likely))

    def _sequence(self, folder_name: str) -> posed.Sequence:
        if folder_name not in self._sequences:
            sequence = read_sequence(self._folders[folder_name])
            self._sequences[folder_name] = replace(sequence, frames=sequence.frames[:: self.options.every])
        return self._sequences[folder_name]

    def _digest_of(self, folder_name: str) -> str:
        sequence = self._sequence(folder_name)
        images = [path for frame in sequence.frames for path in (frame.depth, frame.color) if path is not None]
        paths = sorted({path for path in (*images, *sequence.files) if path.is_file()})
        content = folder_digest(Path(os.path.commonpath(paths)) if len(paths) > 1 else sequence.root, paths)
        return digest([content, vars(sequence.depth_camera)]) if sequence.is_camera_by_name else content

    @cached_property
    def _sequences(self) -> dict[str, posed.Sequence]:
        return {}

    @cached_property
    def _folders(self) -> Mapping[str, Path]:
        """The folder of each sequence, by name."""
        if self.path is None:
            raise PcdbenchError("data set rgbd needs a folder: --dataset rgbd:PATH")
        root = absolute_root("rgbd", self.path)
        if not root.is_dir():
            raise PcdbenchError(f"rgbd:{root}: there is no such folder; check the path")
        if layout_of(root):
            return {scene_names([root.resolve().name], unnamed="sequence")[0]: root}
        found = []
        for folder, subfolders, _ in folders_under(root):
            if layout_of(folder):
                found.append(folder)
                subfolders.clear()
        found.sort()
        if not found:
            raise PcdbenchError(f"{root} holds no sequence in the layout of {', '.join(LAYOUTS)}; see docs/data.md")
        texts = ["-".join(folder.relative_to(root).parts) for folder in found]
        return dict(zip(scene_names(texts, unnamed="sequence"), found, strict=True))


def _warn_of_skipped(sequence: posed.Sequence, whole: Fused) -> None:
    """Say which frames were skipped, and ask about a depth that is of no room."""
    total = len(sequence.frames) + sum((sequence.unusable or {}).values())
    for reason, count in whole.skipped.items():
        warnings.warn(f"{count} of {total} frames have {reason}: skipped", CloudWarning, stacklevel=3)
    if not _NEAREST_M <= whole.median_depth_m <= _FARTHEST_M:
        warnings.warn(
            f"the median depth is {whole.median_depth_m:.3g} m, odd for a room; is the depth scale "
            f"{sequence.depth_scale:g} a metre? It is used as it is; a calibration.json can say another",
            CloudWarning,
            stacklevel=3,
        )
    steps = np.linalg.norm(np.diff(whole.T_world_depth[:, :3, 3], axis=0), axis=1)
    if len(steps) and np.median(steps) > _FARTHEST_M:
        warnings.warn(
            f"the camera moves {np.median(steps):,.0f} m from frame to frame; are the poses in millimetres? They are "
            "used as they are; pcdbench takes metres",
            CloudWarning,
            stacklevel=3,
        )


def _arrays_of(result: Fused) -> dict[str, NDArray]:
    """A fused cloud for an NPZ file: points relative to their mean in single precision, colours in 8 bits."""
    center = result.cloud.points.mean(axis=0)
    arrays = {
        "center": center,
        "points": (result.cloud.points - center).astype(np.float32),
        "normals": result.normals.astype(np.float32),
        "T_world_depth": result.T_world_depth,
        "skipped": np.array(json.dumps(dict(result.skipped))),
        "median_depth_m": np.array(result.median_depth_m),
    }
    if result.cloud.colors is not None:
        arrays["colors"] = np.rint(result.cloud.colors * 255).astype(np.uint8)
    return arrays


def _fused_of(arrays: Mapping[str, NDArray]) -> Fused:
    colors = arrays["colors"].astype(np.float32) / np.float32(255) if "colors" in arrays else None
    return Fused(
        PointCloud(arrays["points"].astype(np.float64) + arrays["center"], colors),
        arrays["normals"].astype(np.float64),
        arrays["T_world_depth"],
        json.loads(str(arrays["skipped"])),
        float(arrays["median_depth_m"]),
    )
