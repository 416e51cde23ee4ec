"""What is installed and what it runs on: versions, machine, threads, caches, plugins. Nothing heavy is imported."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, distribution, requires
from pathlib import Path
from typing import Any

from pcdbench import __version__
from pcdbench.paths import cache_dir
from pcdbench.plugins import KINDS, registry
from pcdbench.threads import thread_count

_NAME = re.compile(r"[A-Za-z0-9._-]+")


def installation() -> dict[str, Any]:
    """Facts as JSON values; what cannot be found out is None."""
    from pcdbench.runner.provenance import provenance

    found = provenance()
    installed = registry()
    return {
        "pcdbench": {"version": __version__, "folder": str(Path(__file__).parents[1]), "git": found["git"]},
        "machine": found["machine"] | {"threads": thread_count()},
        "packages": found["packages"],
        "settings": {name: its for name, its in sorted(os.environ.items()) if name.startswith("PCDBENCH_")}
        | {name: os.environ[name] for name in ("OMP_NUM_THREADS", "CUDA_VISIBLE_DEVICES") if name in os.environ},
        "cache": {"folder": str(cache_dir()), "mb": folder_sizes_mb(cache_dir())},
        "free_disk_gb": {
            name: free_gb(folder)
            for name, folder in (
                ("cache", cache_dir()),
                ("here", Path.cwd()),
                ("temporary", Path(tempfile.gettempdir())),
            )
        },
        "plugins": {
            "found": [
                {"kind": kind, "name": one.name, "origin": one.origin} for kind in KINDS for one in installed.all(kind)
            ],
            "broken": dict(sorted(installed.broken.items())),
            "clashes": installed.clashes(),
        },
    }


def dependencies() -> list[str]:
    """The distributions that pcdbench declares to need, by their normal names."""
    return sorted({normal_name(_NAME.match(text)[0]) for text in _required("pcdbench")})  # type: ignore[index]


def modules_of(name: str) -> list[str]:
    """The modules and packages at the top of an installed distribution.

    Raises:
        PackageNotFoundError: where it is not installed.
    """
    found = set()
    for file in distribution(name).files or ():
        first = file.parts[0]
        if len(file.parts) == 1 and file.suffix in (".py", ".so", ".pyd"):
            found.add(first.partition(".")[0])
        elif len(file.parts) == 2 and file.parts[1].partition(".")[0] == "__init__":
            found.add(first)
    return sorted(name for name in found if name.isidentifier())


def normal_name(name: str) -> str:
    """A distribution's name as PEP 503 writes it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def folder_sizes_mb(folder: Path) -> dict[str, float]:
    """The megabytes in each entry of a folder; links are not followed."""
    if not folder.is_dir():
        return {}
    return {entry.name: round(sum(_file_sizes(Path(entry.path))) / 1e6, 1) for entry in os.scandir(folder)}


def free_gb(folder: Path) -> float | None:
    """The gigabytes free where a folder is or would be made."""
    existing = next((its for its in (folder, *folder.parents) if its.is_dir()), None)
    try:
        return None if existing is None else round(shutil.disk_usage(existing).free / 1e9, 1)
    except OSError:
        return None


def _file_sizes(path: Path) -> Iterator[int]:
    if path.is_symlink() or not path.is_dir():
        yield path.lstat().st_size if path.exists() else 0
        return
    for folder, _, names in os.walk(path):
        for name in names:
            try:
                yield os.lstat(os.path.join(folder, name)).st_size
            except OSError:
                # Another process may have dropped it meanwhile.
                continue


def _required(name: str) -> list[str]:
    """Requirements without those of extras."""
    try:
        return [text for text in requires(name) or () if "extra ==" not in text]
    except PackageNotFoundError:
        return []
