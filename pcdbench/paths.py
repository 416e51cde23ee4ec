"""Where pcdbench keeps what it can make again."""

from __future__ import annotations

import os
from pathlib import Path


def cache_dir() -> Path:
    """The cache folder: `PCDBENCH_CACHE`, else `pcdbench` in the user's cache folder. Deleting it is safe."""
    explicit = os.environ.get("PCDBENCH_CACHE")
    if explicit:
        return Path(explicit)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pcdbench"
