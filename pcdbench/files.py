"""Files that appear complete or not at all, and arrays kept in the cache."""

from __future__ import annotations

import os
import secrets
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pcdbench.errors import CacheWarning

if TYPE_CHECKING:
    from numpy.typing import NDArray

# What a process that was killed while it wrote leaves behind. Hidden, so that no listing takes it for a result.
UNFINISHED = ".unfinished-*"


@contextmanager
def whole_file(path: Path, *, sync: bool = False) -> Iterator[Path]:
    """Write a file so that others see all of it or nothing: the old one, if any, stays until the new one is complete.

    Yields a path in the same folder, with the same extension, to write to; it takes the place of `path` at the end,
    and is removed where anything is raised.

    Args:
        path: its folder is there.
        sync: the bytes are on the disk before the old file goes, so that a crash of the machine loses neither.

    Raises:
        OSError: where it cannot be written; its `filename` is `path` where a write failed (a full disk, say).
    """
    unfinished = path.with_name(UNFINISHED.replace("*", secrets.token_hex(8)) + path.suffix)
    try:
        yield unfinished
        if sync:
            with unfinished.open("rb+") as stream:
                os.fsync(stream.fileno())
        os.replace(unfinished, path)
    except BaseException as error:
        # What fails while writing, unlike what fails while opening, does not say of which file.
        if isinstance(error, OSError) and error.errno is not None and error.filename is None:
            error.filename = str(path)
        with suppress(OSError):
            unfinished.unlink()
        raise


def read_arrays(path: Path) -> dict[str, NDArray[Any]] | None:
    """What an NPZ file holds, or None where it is missing or cannot be read whole."""
    import numpy as np

    try:
        # Opened here, as numpy leaves open what turns out to be no archive.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    # A flipped bit may ask for a password, or for a compression that zipfile does not know: a RuntimeError.
    except (OSError, ValueError, EOFError, KeyError, RuntimeError, zipfile.BadZipFile):
        return None


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Keep arrays in an NPZ file of the cache; `CacheWarning` where that fails."""
    import numpy as np

    def write(unfinished: Path) -> None:
        with unfinished.open("wb") as stream:
            np.savez(stream, allow_pickle=False, **arrays)

    keep(path, write)


def keep(path: Path, write: Callable[[Path], object]) -> None:
    """Have `write` make a file of the cache, in a folder that is made; `CacheWarning` where that fails."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as unfinished:
            write(unfinished)
    except OSError as error:
        message = f"what is made is not kept: {path.parent} cannot be written ({error.strerror or error})"
        warnings.warn(message, CacheWarning, stacklevel=2)
