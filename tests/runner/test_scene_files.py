"""Cells measure the files that their keys name, wherever those lie: on this disk, another machine's, the network."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from pcdbench.cloud import PointCloud
from pcdbench.errors import PcdbenchError
from pcdbench.runner.cluster import _as_workers_find_it
from pcdbench.runner.completions import CompletionCache
from pcdbench.runner.execute import Executor
from pcdbench.runner.plan import Plan, Request, plan
from pcdbench.scene import Scene


@pytest.fixture
def scan(tmp_path: Path, room: Scene, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    path = tmp_path / "scans" / "room.ply"
    path.parent.mkdir()
    room.complete.write(path)
    return path


@pytest.fixture
def address(scan: Path) -> Iterator[str]:
    """Where a server gives the scan, without a digest."""

    class Silent(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Silent, directory=str(scan.parent)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/{scan.name}"
    server.shutdown()
    server.server_close()


def planned(where: str | Path) -> Plan:
    return plan(Request(["incomplete"], ["chamfer"], f"clouds:{where}", levels=[0.3], references=False))


def first_row(its: Plan) -> dict:
    (row,) = Executor(its.dataset, CompletionCache()).rows(its.cells[0], its.tasks)
    return row


def test_a_file_changed_since_the_plan_is_not_measured_under_its_key(scan: Path, room: Scene) -> None:
    its = planned(scan.parent)
    assert first_row(its)["status"] == "ok"
    PointCloud(room.complete.points + 1.0, room.complete.colors).write(scan)
    row = first_row(its)
    assert (row["status"], row["stage"]) == ("failed", "scene")
    assert "not those that the run was planned with" in row["error"]


def test_a_data_set_can_be_an_address_with_a_digest(scan: Path, address: str) -> None:
    digest = hashlib.sha256(scan.read_bytes()).hexdigest()
    its = planned(f"{address}#sha256={digest}")
    assert _as_workers_find_it(its.dataset) == its.dataset
    fetched, local = first_row(its), first_row(planned(scan.parent))
    assert fetched["status"] == "ok" and fetched["points"] == local["points"]


@pytest.mark.parametrize("fragment", ["", "#sha256=" + "0" * 64])
def test_an_address_without_the_digest_of_its_file_is_refused(address: str, fragment: str) -> None:
    with pytest.raises(PcdbenchError, match="digest"):
        planned(address + fragment)


def test_workers_in_other_folders_get_an_absolute_path(scan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(scan.parent.parent)
    assert _as_workers_find_it(planned(scan.parent.name).dataset).path == str(scan.parent)
