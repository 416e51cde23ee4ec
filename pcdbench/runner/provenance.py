"""What a run was made with: package versions, the code's commit, the machine."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, entry_points, requires, version
from pathlib import Path
from typing import Any

import pcdbench
from pcdbench.plugins import GROUP
from pcdbench.threads import core_count


def provenance() -> dict[str, Any]:
    """Facts for `run.json`, as JSON values; what cannot be found out is None."""
    return {
        "packages": package_versions(),
        "git": git_commit(Path(pcdbench.__file__).resolve().parent.parent),
        "machine": {
            "platform": platform.platform(),
            "python": sys.version.split()[0],
            "cpu": _cpu_model(),
            "cores": core_count(),
            "memory_gb": _memory_gb(),
        },
    }


def package_versions() -> dict[str, str]:
    """Versions of pcdbench, of every distribution that brings plugins, and of all that these require."""
    names = {"pcdbench"} | {point.dist.name for point in entry_points(group=GROUP) if point.dist}
    for name in sorted(names):
        try:
            names |= {_bare_name(requirement) for requirement in requires(name) or ()}
        except PackageNotFoundError:
            continue
    versions = {}
    for name in sorted(names):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return versions


def git_commit(folder: Path) -> dict[str, Any] | None:
    """The commit checked out there and whether files differ from it; None where it is no git checkout."""
    if not (folder / ".git").exists():
        return None
    try:
        commit = _git(folder, "rev-parse", "HEAD")
        return {"commit": commit, "modified": bool(_git(folder, "status", "--porcelain", "--untracked-files=no"))}
    except (OSError, subprocess.SubprocessError):
        return None


def _git(folder: Path, *arguments: str) -> str:
    return subprocess.run(
        ["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=True, timeout=10
    ).stdout.strip()


def _bare_name(requirement: str) -> str:
    for end, character in enumerate(requirement):
        if not (character.isalnum() or character in "._-"):
            return requirement[:end]
    return requirement


def _cpu_model() -> str | None:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or None


def _memory_gb() -> float | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1)
    except (ValueError, OSError, AttributeError):
        return None
