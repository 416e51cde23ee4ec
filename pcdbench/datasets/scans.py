"""What every data set of real scans shares: a cloud becomes a scene, files become digests."""

from __future__ import annotations

import os
import re
import stat
import unicodedata
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError, PcdbenchError
from pcdbench.files import keep
from pcdbench.formats import CloudWarning
from pcdbench.geometry.duplicates import repeats
from pcdbench.geometry.extent import no_surface, odd_scale, two_parts
from pcdbench.keys import digest, file_digest
from pcdbench.paths import cache_dir
from pcdbench.scene import Scene, TaggedObject

# With fewer points the lowest usual level, 10 %, takes away no whole one.
FEWEST_POINTS = 10
# More than this is thinned at random before the Poisson-disk sample, whose cost grows with its source.
_MOST_TO_SAMPLE = 2_000_000


def absolute_root(dataset: str, path: Path) -> Path:
    """The file or folder that a data set was given, absolute, `~` expanded.

    Names along it can decide what is read (`Area_1`, the camera of `freiburg1`, the folder above): `.` gets its own.
    A link keeps its name, unless a `..` comes after it.

    Raises:
        PcdbenchError: where a `~` is nobody's.
    """
    try:
        expanded = path.expanduser()
    except RuntimeError:
        raise PcdbenchError(f"{dataset}:{path}: no home folder is known for {path.parts[0]}; give the path") from None
    parts = expanded.absolute().parts
    after = max((place for place, part in enumerate(parts, 1) if part == ".."), default=0)
    return Path(os.path.realpath(Path(*parts[:after])), *parts[after:]) if after else Path(*parts)


def folders_under(root: Path) -> Iterator[tuple[Path, list[str], list[str]]]:
    """Each folder in and under `root`, its subfolders' names, sorted, and its files'; hidden folders are passed over.

    Linked folders are followed, after all that lie there themselves: each folder comes once, and keeps the path that
    it has without links. What is taken out of the subfolders' names is not walked.
    """
    # A link to a folder that `root` is in would come round to it.
    seen = set(root.resolve().parents)
    ahead = [root]
    for start in ahead:
        for name, subfolders, files in os.walk(start):
            folder = Path(name)
            if (real := folder.resolve()) in seen:
                subfolders.clear()
                continue
            seen.add(real)
            subfolders[:] = sorted(its for its in subfolders if not its.startswith("."))
            yield folder, subfolders, files
            ahead += [folder / its for its in subfolders if (folder / its).is_symlink()]


def scene_of_scan(
    name: str,
    scan: PointCloud,
    source: Path,
    complete_points: int,
    seed: int,
    *,
    objects: tuple[TaggedObject, ...] = (),
    partial: PointCloud | None = None,
    viewpoints: NDArray[np.float64] | None = None,
    info: Mapping[str, str] | None = None,
) -> Scene:
    """The scene of a scan: `dense` is all of it, `complete` a Poisson-disk sample of `complete_points` of its points.

    Points that repeat another's coordinates are dropped first. A scale that is odd indoors gets a `CloudWarning`.

    Args:
        source: the file or folder that the scan came from.
        seed: decides the sample.

    Raises:
        CloudError: where the scan is too small to be measured.
    """
    dense = without_duplicates(scan)
    _require_surface(dense, source)
    _warn_of_scale(dense, source)
    index = _sample(dense.points, complete_points, seed)
    extent = " x ".join(f"{side:.2f}" for side in np.ptp(dense.points, axis=0)) + " m"
    return Scene(
        name=name,
        complete=dense.select(index),
        dense=dense,
        complete_index=index,
        objects=objects,
        source=str(source),
        info={"extent": extent, **(info or {})},
        partial=partial,
        viewpoints=viewpoints,
    )


def scene_names(texts: Sequence[str], longer: Sequence[str] | None = None, *, unnamed: str = "cloud") -> list[str]:
    """A name for each scene of a data set, no two alike on any system.

    Letters of any script, digits, `.`, `_` and `-` stay, all else becomes `_`; no name is hidden or empty. Those that
    would clash, in capitals alone too, are made of the `longer` texts, and get a number where that is not enough.

    Args:
        texts: what the scenes are called: parts of their paths, say.
        longer: as many, that tell more.
        unnamed: for a scene of whose text nothing stays.
    """
    names = [_safe(text) or unnamed for text in texts]
    clashing = Counter(name.lower() for name in names)
    names = [
        name if clashing[name.lower()] == 1 else _safe(text) or unnamed
        for name, text in zip(names, texts if longer is None else longer, strict=True)
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


def without_duplicates(cloud: PointCloud) -> PointCloud:
    """The cloud without the points that repeat an earlier one's coordinates."""
    again = repeats(cloud.points)
    return cloud.select(~again) if again.any() else cloud


def content_digest(path: Path) -> str:
    """SHA-256 of a file, computed once as long as the file stays as it is.

    Raises:
        CloudError: where it cannot be read.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise CloudError(f"{path} cannot be read: it is no file; check the path")
        return _digest_of_version(path, status.st_size, status.st_mtime_ns)
    except OSError as error:
        raise CloudError(f"{path} cannot be read: {error.strerror}; check the file") from error


def folder_digest(root: Path, paths: Sequence[Path]) -> str:
    """Digest of the names and bytes of files under `root`; remembered in the cache folder while they stay as they are.

    Raises:
        CloudError: where one cannot be read.
    """
    try:
        states = [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in paths]
    except OSError as error:
        raise CloudError(f"{error.filename} cannot be read: {error.strerror}; check the file") from error
    memory = cache_dir() / "digests" / digest(states)
    try:
        return memory.read_text()
    except OSError:
        pass
    found = digest([(path.relative_to(root).as_posix(), content_digest(path)) for path in paths])
    keep(memory, lambda unfinished: unfinished.write_text(found))
    return found


@lru_cache(maxsize=16384)
def _digest_of_version(path: Path, size: int, modified_ns: int) -> str:
    return file_digest(path)


def _safe(text: str) -> str:
    # File systems differ in how they spell an accented letter: as one character, or as two.
    return re.sub(r"[^\w.-]+", "_", unicodedata.normalize("NFC", text)).lstrip(".")


def _require_surface(cloud: PointCloud, path: Path) -> None:
    if len(cloud) < FEWEST_POINTS:
        raise CloudError(
            f"{path} has {len(cloud)} distinct points; at least {FEWEST_POINTS} are needed to take some away"
        )
    wrong = no_surface(cloud.points)
    if wrong is not None:
        raise CloudError(f"{path}: {wrong}")


def _warn_of_scale(cloud: PointCloud, path: Path) -> None:
    longest = float(np.ptp(cloud.points, axis=0).max())
    odd = odd_scale(longest)
    if odd is not None:
        told = two_parts(cloud.points) or f"its {odd}"
        warnings.warn(f"{path}: {told}; it is used as it is", CloudWarning, stacklevel=4)


def _sample(points: NDArray[np.float64], count: int, seed: int) -> NDArray[np.int64]:
    """Sorted rows of a Poisson-disk sample of `count` points (all of them where there are no more)."""
    from pcdbench.geometry.sampling import poisson_disk_indices

    rng = np.random.default_rng(seed)
    if len(points) <= _MOST_TO_SAMPLE:
        return poisson_disk_indices(points, count, rng)
    rows = np.sort(rng.choice(len(points), max(_MOST_TO_SAMPLE, count), replace=False))
    return rows[poisson_disk_indices(points[rows], count, rng)]
