"""The data set `clouds`: a scan, or a folder of scans, on disk."""

from __future__ import annotations

import os
import re
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pcdbench import options
from pcdbench.cloud import PointCloud
from pcdbench.dataset import Dataset
from pcdbench.datasets.boxes import boxes_file, read_boxes
from pcdbench.errors import CloudError, PcdbenchError
from pcdbench.formats import EXTENSIONS, CloudWarning, read_cloud
from pcdbench.formats.text import holds_points
from pcdbench.keys import digest, file_digest, seed_from
from pcdbench.scene import Scene

# With fewer points the lowest usual level, 10 %, takes away no whole one.
_FEWEST_POINTS = 10
# A cloud this much thinner than long (standard deviations) is a line: it has no surface to complete.
_THINNEST = 1e-5
# More than this is thinned at random before the Poisson-disk sample, whose cost grows with its source.
_MOST_TO_SAMPLE = 2_000_000
_SMALLEST_M, _LARGEST_M = 0.5, 500.0
_HASH_FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
# Folders of scans hold notes and tables under these extensions too.
_NOTES_EXTENSIONS = (".txt", ".csv")


class Clouds(Dataset):
    """The clouds of one file, or of a folder and its subfolders; a cloud is a scene.

    Points are kept where the file has them: a scan in map coordinates gives a scene in map coordinates.
    """

    class Options(options.Options):
        complete_points: int = Field(
            20_000, ge=_FEWEST_POINTS, description="points of the complete cloud (all of the file's where it has fewer)"
        )
        draws: int = Field(1, ge=1, description="cases, each of another seed, of a scene at each level")

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

    def scene(self, name: str) -> Scene:
        """Read one cloud: `dense` is all of it, `complete` a Poisson-disk sample of `complete_points` of its points.

        Points that repeat another's coordinates are dropped first. The sample is seeded by the file's content.

        Raises:
            CloudError: where the file cannot be read or its cloud is too small to be measured.
        """
        path = self._file(name)
        dense = _without_duplicates(read_cloud(path))
        _require_surface(dense, path)
        _warn_of_scale(dense, path)
        boxes = boxes_file(path)
        index = _sample(dense.points, self.options.complete_points, seed_from("clouds", _content_digest(path)))
        return Scene(
            name=name,
            complete=dense.select(index),
            dense=dense,
            complete_index=index,
            objects=() if boxes is None else read_boxes(boxes, path, len(self._clouds_in(path.parent)) == 1),
            source=str(path),
            info={"extent": " x ".join(f"{side:.2f}" for side in np.ptp(dense.points, axis=0)) + " m"},
        )

    def digest(self, name: str) -> str:
        """Digest of the scene's name and the bytes of the cloud's file and of its boxes' file.

        With the name, so that two copies of a file are two scenes.
        """
        path = self._file(name)
        boxes = boxes_file(path)
        return digest([name, _content_digest(path), None if boxes is None else _content_digest(boxes)])

    def _file(self, name: str) -> Path:
        if name not in self._files:
            raise PcdbenchError(f"data set clouds:{self.path} has no scene {name!r}; pcdbench run names those it has")
        return self._files[name]

    @cached_property
    def _files(self) -> Mapping[str, Path]:
        """Each scene's file, by the scene's name."""
        if self.path is None:
            raise PcdbenchError("data set clouds needs a file or folder: --dataset clouds:PATH")
        root = self.path.expanduser()
        if not root.exists():
            raise PcdbenchError(f"clouds:{root}: there is no such file or folder; check the path")
        if not root.is_dir():
            return {_safe(root.stem): root}
        paths = _cloud_paths(root)
        if not paths:
            raise PcdbenchError(f"{root} holds no cloud; put files of these formats there: {' '.join(EXTENSIONS)}")
        return dict(zip(_scene_names([path.relative_to(root) for path in paths]), paths, strict=True))

    @staticmethod
    def _clouds_in(folder: Path) -> list[Path]:
        return [path for path in folder.iterdir() if _is_cloud(path) and not path.name.startswith(".")]


def _cloud_paths(root: Path) -> list[Path]:
    """All clouds under `root`, sorted; hidden files and folders are passed over."""
    found = []
    for folder, subfolders, names in os.walk(root):
        subfolders[:] = [name for name in subfolders if not name.startswith(".")]
        found += [Path(folder, name) for name in names if not name.startswith(".")]
    return sorted(path for path in found if _is_cloud(path))


def _is_cloud(path: Path) -> bool:
    """Whether a folder's file is taken for a cloud: by its extension, and .txt and .csv by their first rows too."""
    extension = path.suffix.lower()
    return extension in EXTENSIONS and (extension not in _NOTES_EXTENSIONS or holds_points(path))


def _scene_names(paths: Sequence[Path]) -> list[str]:
    """A name for each relative path: its parts without extension; with it, and a number, only where names clash."""
    names = [_safe("-".join(path.with_suffix("").parts)) for path in paths]
    clashing = Counter(name.lower() for name in names)
    names = [
        name if clashing[name.lower()] == 1 else _safe("-".join(path.parts))
        for name, path in zip(names, paths, strict=True)
    ]
    taken: set[str] = set()
    unique = []
    for name in names:
        number, candidate = 1, name
        while candidate.lower() in taken:
            number += 1
            candidate = f"{name}-{number}"
        taken.add(candidate.lower())
        unique.append(candidate)
    return unique


def _safe(text: str) -> str:
    """Letters, digits, `.`, `_` and `-`, all else made `_`; never hidden and never empty."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", text).lstrip(".") or "cloud"


def _content_digest(path: Path) -> str:
    """SHA-256 of a file, computed once as long as the file stays as it is."""
    try:
        status = path.stat()
        return _digest_of_version(path, status.st_size, status.st_mtime_ns)
    except OSError as error:
        raise CloudError(f"{path} cannot be read: {error.strerror}; check the file") from error


@lru_cache(maxsize=4096)
def _digest_of_version(path: Path, size: int, modified_ns: int) -> str:
    return file_digest(path)


def _without_duplicates(cloud: PointCloud) -> PointCloud:
    """The cloud without the points that repeat an earlier one's coordinates."""
    # Equal points have equal hashes: only the few that share one are compared, which is fast for millions.
    bits = (cloud.points + 0.0).view(np.uint64)
    bits ^= bits >> np.uint64(32)
    hashes = bits @ _HASH_FACTORS
    order = np.argsort(hashes, kind="stable")
    same = np.diff(hashes[order]) == 0
    suspects = np.sort(order[np.append(same, False) | np.insert(same, 0, False)])
    if not len(suspects):
        return cloud
    _, first = np.unique(cloud.points[suspects], axis=0, return_index=True)
    kept = np.ones(len(cloud), dtype=bool)
    kept[suspects] = False
    kept[suspects[first]] = True
    return cloud.select(kept)


def _require_surface(cloud: PointCloud, path: Path) -> None:
    if len(cloud) < _FEWEST_POINTS:
        raise CloudError(
            f"{path} has {len(cloud)} distinct points; at least {_FEWEST_POINTS} are needed to take some away"
        )
    _, middle, largest = np.linalg.eigvalsh(np.cov(cloud.points - cloud.points[0], rowvar=False))
    if middle <= _THINNEST**2 * largest:
        raise CloudError(f"{path}: its {len(cloud):,} points lie on one line; there is no surface to complete")


def _warn_of_scale(cloud: PointCloud, path: Path) -> None:
    longest = float(np.ptp(cloud.points, axis=0).max())
    if not _SMALLEST_M <= longest <= _LARGEST_M:
        guess = "millimetres" if longest > _LARGEST_M else "kilometres or normalised"
        warnings.warn(
            f"{path}: its longest side is {longest:,.4g} m, odd for an indoor scan; is its unit {guess}? "
            "It is used as it is; pcdbench takes metres",
            CloudWarning,
            stacklevel=3,
        )


def _sample(points: NDArray[np.float64], count: int, seed: int) -> NDArray[np.int64]:
    """Sorted rows of a Poisson-disk sample of `count` points (all of them where there are no more)."""
    from pcdbench.geometry.sampling import poisson_disk_indices

    rng = np.random.default_rng(seed)
    if len(points) <= _MOST_TO_SAMPLE:
        return poisson_disk_indices(points, count, rng)
    rows = np.sort(rng.choice(len(points), max(_MOST_TO_SAMPLE, count), replace=False))
    return rows[poisson_disk_indices(points[rows], count, rng)]
