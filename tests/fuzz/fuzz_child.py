"""A process that reads damaged files, one after the other, under a limit of memory, and tells how each ended.

Native readers may crash, hang or ask for all memory there is; then this process is what it costs.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
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
# Of processor time: no file here is larger than some kilobytes. The signal ends native loops too.
LONGEST_S = 20.0


def _cloud(path: Path) -> None:
    from pcdbench.formats import read_cloud, read_cloud_and_fields

    cloud = read_cloud(path)
    assert len(cloud) and np.isfinite(cloud.points).all()
    assert cloud.colors is None or (cloud.colors.min() >= 0 and cloud.colors.max() <= 1)
    again, fields = read_cloud_and_fields(path)
    assert len(again) == len(cloud)
    for name, values in fields.items():
        assert isinstance(name, str) and len(values) == len(cloud)


def _boxes(path: Path) -> None:
    from pcdbench.datasets.boxes import read_boxes

    for tagged in read_boxes(path, path.with_name("scan.ply"), True, 10.0):
        assert tagged.label and np.isfinite(tagged.box.center).all()


def _run(path: Path) -> None:
    """The summary of a run, one of whose two files is the one given; its folder holds the other."""
    from pcdbench.cli.results import print_summary
    from pcdbench.leaderboard.results import rows_of_run

    for format in ("json", "csv", "markdown", "table"):
        print_summary(rows_of_run(path.parent), path.parent, format)


def _suite(path: Path) -> None:
    """What a suite asks for; what of it cannot be is told by one line that need not name the suite."""
    from pcdbench.runner.plan import plan
    from pcdbench.suite import read_suite, requests

    suite = read_suite(path)
    try:
        asked = requests(suite, path.parent)
        # Where data lie is not the file's alone: a path that was changed to / would be walked.
        asked = requests(suite, path.parent, dataset=f"clouds:{path.with_name('scan.xyz')}")
        for request in asked[:3]:
            assert plan(request).tasks
    except PcdbenchError as error:
        assert "\n" not in str(error)


def _board(path: Path) -> None:
    """The check of a board by another one."""
    from pcdbench.leaderboard.board_file import board_json, read_board
    from pcdbench.leaderboard.gate import check
    from pcdbench.leaderboard.gate_report import verdict_junit, verdict_markdown, verdict_text

    board = read_board(path)
    sound = read_board(path.with_name("sound.json"))
    for committed, fresh in ((board, board), (board, sound), (sound, board)):
        try:
            verdict = check(committed, fresh)
        except PcdbenchError as error:
            assert "\n" not in str(error)
        else:
            assert verdict_text(verdict) and verdict_markdown(verdict) and verdict_junit(verdict)
    assert board_json(board)


def _build(path: Path) -> None:
    """The board that is made of a run, one of whose two files is the one given, and its pages."""
    from pcdbench.leaderboard.board_file import board_json
    from pcdbench.leaderboard.board_readme import board_readme
    from pcdbench.leaderboard.building import board_of_runs
    from pcdbench.leaderboard.merging import data_paths
    from pcdbench.leaderboard.page import board_page

    try:
        board = board_of_runs("fuzzed", [path.parent])
    except PcdbenchError as error:
        if path.name in str(error):
            raise
        # What contradicts itself is told of the folder.
        assert "\n" not in str(error) and str(path.parent) in str(error)
        return
    data_paths([path.parent])
    assert board_json(board) and board_readme(board, {}, ["build"], path.parent)
    assert board_page(board, (), case_command="case")


def _sequence(path: Path) -> None:
    from pcdbench.datasets.rgbd.layouts import layout_of, read_sequence

    folder = next(folder for folder in path.parents if layout_of(folder))
    read_sequence(folder)


def _s3dis(path: Path) -> None:
    from pcdbench.datasets.s3dis.text import read_rows

    rows, findings = read_rows(path, path.name)
    assert np.isfinite(rows).all() and rows.shape[1] in (3, 6) and len(findings) < 20


def _weights(path: Path) -> None:
    import torch

    from pcdbench.weights import Weights

    own = path.with_name(path.name.partition(".")[0] + ".safetensors")
    Weights(Path("none"), str(own), "net").load_into(torch.nn.Linear(3, 2))


def _checkpoint(path: Path) -> None:
    import torch

    from pcdbench.training.loop import resumed

    network, average = torch.nn.Linear(3, 2), {}
    optimizer = torch.optim.Adam(network.parameters())
    assert resumed(path, network, average, optimizer).step >= 0
    torch.nn.Linear(3, 2).load_state_dict(average)
    network(torch.ones(1, 3)).sum().backward()
    optimizer.step()


TARGETS: dict[str, Callable[[Path], None]] = {
    "cloud": _cloud,
    "boxes": _boxes,
    "run": _run,
    "suite": _suite,
    "board": _board,
    "build": _build,
    "sequence": _sequence,
    "s3dis": _s3dis,
    "weights": _weights,
    "checkpoint": _checkpoint,
}
# The libraries' own size is not that of a file.
_LIBRARIES = {
    "cloud": ("laspy", "lazrs", "pye57"),
    "boxes": ("pcdbench.datasets.boxes",),
    "run": ("pcdbench.cli.results", "pcdbench.leaderboard.results", "pcdbench.leaderboard.render", "rich.table"),
    "suite": (
        "pcdbench.suite",
        "pcdbench_tasks.chamfer",
        "pcdbench_completers.plane_fitting",
        "pcdbench.datasets.clouds",
    ),
    "board": ("pcdbench.leaderboard.board_file", "pcdbench.leaderboard.gate", "pcdbench.leaderboard.gate_report"),
    "build": ("pcdbench.leaderboard.building", "pcdbench.leaderboard.page", "pcdbench.leaderboard.board_readme"),
    "sequence": ("pcdbench.datasets.rgbd.layouts",),
    "s3dis": ("pcdbench.datasets.s3dis.text",),
    "weights": ("pcdbench.weights", "safetensors.torch"),
    "checkpoint": ("pcdbench.training.loop", "safetensors.torch", "torch.optim.adam", "torch._dynamo"),
}


def prepare(target: str) -> None:
    """Import what reading a target takes, and limit what the file may ask for beyond that."""
    for library in _LIBRARIES.get(target, ()):
        importlib.import_module(library)
    limit = _status_kb("VmSize") * 1024 + _LIMIT_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))


def outcome(target: str, path: Path) -> dict[str, object]:
    """How reading a file ended: "read", "refused" (by a one-line error) or "raised", with memory and time."""
    Path("/proc/self/clear_refs").write_text("5")
    before, start = _status_kb("VmRSS"), time.process_time()
    ended, message = "read", ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
            TARGETS[target](path)
    except PcdbenchError as error:
        ended, message = "refused", str(error)
    except BaseException:
        ended, message = "raised", traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    grown_mb = (_status_kb("VmHWM") - before) / 1024
    return {"ended": ended, "message": message, "grown_mb": grown_mb, "seconds": time.process_time() - start}


def _status_kb(name: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1])
    raise LookupError(name)


def main() -> None:
    """Answer each line "TARGET PATH" on standard input with a line of JSON."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    prepared = ""
    for line in sys.stdin:
        target, _, path = line.rstrip("\n").partition(" ")
        if target != prepared:
            resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
            prepare(target)
            prepared = target
            answers.write("prepared\n")
            answers.flush()
        answers.write(json.dumps(outcome(target, Path(path))) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
