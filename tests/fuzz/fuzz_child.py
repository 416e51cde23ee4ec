"""A process that reads damaged files, one after the other, under a limit of memory, and tells how each ended.

Native readers may crash, hang or ask for all memory there is; then this process is what it costs.
"""

from __future__ import annotations

import json
import resource
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pcdbench.errors import PcdbenchError

# What a file may make this process ask for beyond what it has; malloc then fails instead of swapping.
_LIMIT_BYTES = 2 << 30


def _cloud(path: Path) -> None:
    from pcdbench.formats import carries_fields, read_cloud, read_fields

    problem = None
    try:
        cloud = read_cloud(path)
        assert len(cloud) and np.isfinite(cloud.points).all()
        assert cloud.colors is None or (cloud.colors.min() >= 0 and cloud.colors.max() <= 1)
    except PcdbenchError as error:
        problem = error
    if carries_fields(path):
        for name, values in read_fields(path).items():
            assert isinstance(name, str) and values.ndim == 1
    if problem is not None:
        raise problem


def _boxes(path: Path) -> None:
    from pcdbench.datasets.boxes import read_boxes

    for tagged in read_boxes(path, path.with_name("scan.ply"), True):
        assert tagged.label and np.isfinite(tagged.box.center).all()


def _run(path: Path) -> None:
    """The summary of a run, one of whose two files is the one given; its folder holds the other."""
    from pcdbench.cli.results import print_summary
    from pcdbench.leaderboard.results import rows_of_run

    for format in ("json", "csv", "markdown", "table"):
        print_summary(rows_of_run(path.parent), path.parent, format)


TARGETS: dict[str, Callable[[Path], None]] = {"cloud": _cloud, "boxes": _boxes, "run": _run}


def outcome(target: str, path: Path) -> dict[str, object]:
    """How reading a file ended: "read", "refused" (by a one-line error) or "raised", with memory and time."""
    Path("/proc/self/clear_refs").write_text("5")
    before, start = _status_kb("VmRSS"), time.monotonic()
    ended, message = "read", ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            TARGETS[target](path)
    except PcdbenchError as error:
        ended, message = "refused", str(error)
    except BaseException:
        ended, message = "raised", traceback.format_exc()
    grown_mb = (_status_kb("VmHWM") - before) / 1024
    return {"ended": ended, "message": message, "grown_mb": grown_mb, "seconds": time.monotonic() - start}


def _status_kb(name: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1])
    raise LookupError(name)


def main() -> None:
    """Answer each line "TARGET PATH" on standard input with a line of JSON."""
    import os

    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    import laspy  # noqa: F401  the libraries' own size is not that of a file
    import pandas  # noqa: F401
    import pye57  # noqa: F401

    limit = _status_kb("VmSize") * 1024 + _LIMIT_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for line in sys.stdin:
        target, _, path = line.rstrip("\n").partition(" ")
        answers.write(json.dumps(outcome(target, Path(path))) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
