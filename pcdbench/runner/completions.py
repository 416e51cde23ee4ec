"""Completed clouds kept on disk by their cell's key, so that another task, or a picture, need not wait again."""

from __future__ import annotations

import contextlib
import json
import math
import os
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pcdbench.cloud import PointCloud
from pcdbench.errors import CacheWarning, CloudError, PcdbenchError
from pcdbench.files import UNFINISHED, read_arrays, whole_file
from pcdbench.keys import canonical_json
from pcdbench.paths import cache_dir

LIMIT_VARIABLE = "PCDBENCH_COMPLETIONS_MB"
DEFAULT_LIMIT_MB = 4000.0
_TORN_AFTER_SECONDS = 3600.0


@dataclass(frozen=True)
class Completion:
    """A completed cloud and what it cost when it was made.

    Attributes:
        facts: JSON values: seconds, peak memory, device.
    """

    cloud: PointCloud
    facts: Mapping[str, Any]


class CompletionCache:
    """A folder of completions, the longest unused of which are dropped beyond a size.

    Several processes may use it at once: a file appears complete or not at all, and one that vanished or was
    damaged is a completion to be made again.

    Args:
        folder: `completions` in the cache folder unless given.
        limit_mb: its size; `PCDBENCH_COMPLETIONS_MB` unless given; 0 keeps nothing and finds nothing, `inf` all.

    Raises:
        PcdbenchError: where the variable holds no size.
    """

    def __init__(self, folder: Path | None = None, limit_mb: float | None = None) -> None:
        # A completer may change the working folder before its completion is kept.
        self.folder = (cache_dir() / "completions" if folder is None else folder).absolute()
        self.limit_bytes = (_limit_mb() if limit_mb is None else limit_mb) * 1e6
        self._written = 0

    def get(self, key: str) -> Completion | None:
        """The completion of this key, now the most recently used, or None."""
        path = self._path(key)
        stored = read_arrays(path) if self.limit_bytes > 0 else None
        if stored is None:
            return None
        try:
            cloud = PointCloud(stored["points"], stored.get("colors"))
            completion = Completion(cloud, json.loads(str(stored["facts"])))
            os.utime(path)
        except (OSError, ValueError, KeyError, CloudError):
            return None
        return completion

    def put(self, key: str, completion: Completion) -> None:
        """Keep a completion; where that fails (a full disk) there is one `CacheWarning`, and the run goes on."""
        if self.limit_bytes <= 0:
            return
        try:
            self._written += self._write(self._path(key), completion)
        except OSError as error:
            message = f"completed clouds are not kept: {self.folder} cannot be written ({error.strerror})"
            warnings.warn(message, CacheWarning, stacklevel=2)
        if self._written > self.limit_bytes / 20:
            self.trim()

    def trim(self) -> None:
        """Drop what was not used for the longest time until the folder fits its size, and what killed runs tore.

        A cache of no size is one that is not used: what other runs keep is not its own.
        """
        if self.limit_bytes <= 0:
            return
        self._written = 0
        for torn in (*self.folder.glob(f"*/{UNFINISHED}"), *self.folder.glob("*/*.tmp")):
            with contextlib.suppress(OSError):
                if time.time() - torn.stat().st_mtime > _TORN_AFTER_SECONDS:
                    torn.unlink()
        files = []
        for path in self.folder.glob("*/[!.]*.npz"):
            with contextlib.suppress(OSError):
                status = path.stat()
                files.append((status.st_mtime, status.st_size, path))
        total = sum(size for _, size, _ in files)
        for _, size, path in sorted(files):
            if total <= self.limit_bytes:
                return
            with contextlib.suppress(OSError):
                path.unlink()
            total -= size

    def _write(self, path: Path, completion: Completion) -> int:
        """Write the file, so that it appears complete or not at all; its bytes."""
        import numpy as np

        arrays: dict[str, Any] = {"points": completion.cloud.points, "facts": canonical_json(dict(completion.facts))}
        if completion.cloud.colors is not None:
            arrays["colors"] = completion.cloud.colors
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as unfinished, unfinished.open("wb") as stream:
            np.savez(stream, allow_pickle=False, **arrays)
        return path.stat().st_size

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.npz"


def _limit_mb() -> float:
    text = os.environ.get(LIMIT_VARIABLE, "").strip()
    try:
        limit = float(text) if text else DEFAULT_LIMIT_MB
    except ValueError:
        limit = math.nan
    if not limit >= 0:
        raise PcdbenchError(f"{LIMIT_VARIABLE} is {text!r}; give megabytes: 0 keeps no completed clouds, inf all")
    return limit
