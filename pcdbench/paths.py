"""Where pcdbench keeps what it can make again, and whether it can write where a user says."""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from pathlib import Path

from pcdbench.errors import PcdbenchError

_LONGEST_NAME = 120
# Names that Windows keeps for devices, with any extension.
_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)


def cache_dir() -> Path:
    """The cache folder: `PCDBENCH_CACHE`, else `pcdbench` in the user's cache folder. Deleting it is safe."""
    explicit = os.environ.get("PCDBENCH_CACHE")
    if explicit:
        return Path(explicit)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pcdbench"


def file_name(text: str) -> str:
    """A name for a file or folder that any system takes: letters, digits, `.`, `_`, `-`, never hidden or a path.

    A text that is such a name stays; another is changed and ends in its digest, so that different texts have
    different names. Names of scenes and figures come from data sets and plugins: `../../x` must not leave a folder.
    """
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", text).strip(".")
    if _DEVICES.fullmatch(name):
        name = f"_{name}"
    if name == text and 0 < len(name) <= _LONGEST_NAME:
        return name
    return f"{name[: _LONGEST_NAME - 9]}-{hashlib.sha256(text.encode('utf-8', 'surrogatepass')).hexdigest()[:8]}"


def require_writable(folder: Path) -> None:
    """Try a file in a folder, or in the one that it would be made in; nothing stays behind.

    Raises:
        PcdbenchError: where no file can be written.
    """
    try:
        existing = next(place for place in (folder, *folder.absolute().parents) if place.exists())
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        raise PcdbenchError(f"{folder} cannot be written: {error.strerror}; choose another place") from error
