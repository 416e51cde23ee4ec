"""Files from elsewhere: used only if their digest matches, kept by it, and never fetched unasked."""

import hashlib
import io
import sys
import threading
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import fsspec
import numpy as np
import pytest
from fsspec import AbstractFileSystem
from fsspec.implementations.memory import MemoryFileSystem
from safetensors.numpy import save

from pcdbench import PointCloud
from pcdbench.downloads import downloaded, is_address
from pcdbench.errors import PcdbenchError
from pcdbench.runner.plan import Request, plan
from pcdbench.suite import Suite, requests
from pcdbench.weights import Weights

CONTENT = save({"weight": np.arange(6, dtype=np.float32).reshape(2, 3)})
DIGEST = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, list[str]]]:
    """A server on loopback that answers every path with CONTENT but /other, and what it was asked for."""
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    asked: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(404 if self.path == "/gone.safetensors" else 200)
            self.end_headers()
            self.wfile.write(b"another file" if self.path == "/other.safetensors" else CONTENT)

        def log_message(self, *_: object) -> None:
            pass

    http = HTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=http.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{http.server_port}", asked
    http.shutdown()
    http.server_close()


def test_weights_are_fetched_once_and_kept_by_their_digest(server: tuple[str, list[str]], tmp_path: Path) -> None:
    address, asked = server
    for _ in range(2):
        weights = Weights(Path("none"), f"{address}/net.safetensors#sha256={DIGEST.upper()}", "net")
        assert weights.digest == DIGEST and weights.path.name == f"{DIGEST}.safetensors"
    assert weights.path.is_relative_to(tmp_path / "cache")
    assert np.array_equal(weights.tensors()["weight"].numpy(), np.arange(6).reshape(2, 3))
    assert asked == ["/net.safetensors"]


def test_a_kept_file_that_was_changed_is_fetched_anew(server: tuple[str, list[str]]) -> None:
    address, asked = server
    path = downloaded(f"{address}/net.safetensors#sha256={DIGEST}")
    path.write_bytes(b"changed")
    assert downloaded(f"{address}/net.safetensors#sha256={DIGEST}").read_bytes() == CONTENT
    assert len(asked) == 2


def test_another_file_is_not_used_and_not_kept(server: tuple[str, list[str]], tmp_path: Path) -> None:
    address, _ = server
    with pytest.raises(PcdbenchError, match=r"other\.safetensors is not the file of that digest") as caught:
        downloaded(f"{address}/other.safetensors#sha256={DIGEST}")
    assert "\n" not in str(caught.value)
    assert [path for path in (tmp_path / "cache").rglob("*") if path.is_file()] == []


@pytest.mark.parametrize("fragment", ["", "#", "#sha256=", "#sha256=12ab", f"#md5={DIGEST[:32]}", f"#sha256={DIGEST}0"])
def test_without_a_digest_nothing_is_asked_for(server: tuple[str, list[str]], fragment: str) -> None:
    address, asked = server
    with pytest.raises(PcdbenchError, match="needs the file's digest"):
        downloaded(f"{address}/net.safetensors{fragment}")
    assert asked == []


def test_what_cannot_be_reached_is_told_in_one_line(server: tuple[str, list[str]]) -> None:
    address, _ = server
    for url in (f"{address}/gone.safetensors", "http://127.0.0.1:9/net.safetensors", "http://[/x"):
        with pytest.raises(PcdbenchError, match=r"cannot be (downloaded|used)") as caught:
            downloaded(f"{url}#sha256={DIGEST}")
        assert "\n" not in str(caught.value)


def test_names_in_an_address_do_not_leave_the_cache(server: tuple[str, list[str]], tmp_path: Path) -> None:
    address, _ = server
    path = downloaded(f"{address}/a/../../b.x%2f..%2fy?name=/etc/passwd#sha256={DIGEST}")
    assert path.parent == tmp_path / "cache" / "downloads"


def test_paths_are_no_addresses() -> None:
    assert all(map(is_address, ("HTTPS://a/b", "http://a", "s3://a/b", "file:///a", "ssh://a@b/c", "zip://a::s3://b")))
    assert not any(map(is_address, ("", "weights.safetensors", "/https://a", "C:/a", "C://a", r"C:\a")))


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Path, AbstractFileSystem]]:
    """An empty cache and fsspec's file system in memory."""
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "cache"))
    memory = fsspec.filesystem("memory")
    yield tmp_path, memory
    memory.store.clear()


def kept(folder: Path) -> list[Path]:
    return [path for path in (folder / "cache").rglob("*") if path.is_file()]


def test_any_protocol_of_fsspec_is_read_once_and_kept_by_the_digest(
    places: tuple[Path, AbstractFileSystem], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, memory = places
    large = np.random.default_rng(0).bytes(3_000_000)  # several blocks
    memory.pipe("/rooms/a#1.ply", large)
    address = f"memory://rooms/a#1.ply#sha256={hashlib.sha256(large).hexdigest()}"
    path = downloaded(address)
    assert path.read_bytes() == large and path.suffix == ".ply" and kept(folder) == [path]
    memory.store.clear()
    assert downloaded(address) == path
    path.write_bytes(b"changed")
    with pytest.raises(PcdbenchError, match=r"memory://rooms/a#1\.ply cannot be read \(there is no such file\)"):
        downloaded(address)


def test_a_file_on_disk_and_one_inside_a_zip(places: tuple[Path, AbstractFileSystem]) -> None:
    folder, _ = places
    (folder / "net.safetensors").write_bytes(CONTENT)
    weights = Weights(Path("none"), f"{(folder / 'net.safetensors').as_uri()}#sha256={DIGEST}", "net")
    assert weights.digest == DIGEST
    weights.path.unlink()
    with zipfile.ZipFile(folder / "all.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a/net.safetensors", CONTENT)
    path = downloaded(f"zip://a/net.safetensors::{(folder / 'all.zip').as_uri()}#sha256={DIGEST}")
    assert path == weights.path and path.read_bytes() == CONTENT


def test_another_file_of_any_protocol_is_not_used_and_not_kept(places: tuple[Path, AbstractFileSystem]) -> None:
    folder, memory = places
    memory.pipe("/net.safetensors", CONTENT + b"and more")
    with pytest.raises(PcdbenchError, match="is not the file of that digest"):
        downloaded(f"memory://net.safetensors#sha256={DIGEST}")
    with pytest.raises(PcdbenchError, match="needs the file's digest"):
        downloaded("memory://net.safetensors")
    assert kept(folder) == []


@pytest.mark.parametrize(
    "url",
    ["nosuch://a/b.ply", "oss://bucket/b.ply", "file:///nosuch/b.ply", "file:///", "hf://x", "zip://a::file:///x"],
)
def test_protocols_and_files_that_are_not_there_are_one_line(places: tuple[Path, AbstractFileSystem], url: str) -> None:
    folder, _ = places
    with pytest.raises(PcdbenchError, match="cannot be read") as caught:
        downloaded(f"{url}#sha256={DIGEST}")
    assert "\n" not in str(caught.value) and url in str(caught.value) and kept(folder) == []


def test_a_missing_package_of_a_protocol_is_named(
    places: tuple[Path, AbstractFileSystem], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "s3fs", None)
    with pytest.raises(PcdbenchError, match=r"s3://bucket/b\.ply cannot be read \(.*s3fs"):
        downloaded(f"s3://bucket/b.ply#sha256={DIGEST}")


def test_a_connection_that_breaks_leaves_nothing(
    places: tuple[Path, AbstractFileSystem], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, memory = places
    memory.pipe("/net.safetensors", CONTENT)

    class Broken(io.BytesIO):
        def read(self, size: int | None = -1) -> bytes:
            if self.tell():
                raise RuntimeError("the line\nis dead")
            return super().read(10)

    monkeypatch.setattr(MemoryFileSystem, "_open", lambda *_, **__: Broken(CONTENT))
    with pytest.raises(PcdbenchError, match=r"cannot be read \(the line is dead\)"):
        downloaded(f"memory://net.safetensors#sha256={DIGEST}")
    assert kept(folder) == []


def test_clouds_are_read_from_an_address(places: tuple[Path, AbstractFileSystem]) -> None:
    folder, memory = places
    cloud = PointCloud(np.random.default_rng(0).uniform(0, 4, (3000, 3)))
    cloud.write(folder / "room.ply")
    data = (folder / "room.ply").read_bytes()
    memory.pipe("/room.ply", data)
    address = f"clouds:memory://room.ply#sha256={hashlib.sha256(data).hexdigest()}"
    planned = plan(Request(["plane_fitting"], ["chamfer"], dataset=address))
    assert list(planned.scenes.values()) == list(
        plan(replace(Request(["plane_fitting"], ["chamfer"]), dataset=f"clouds:{kept(folder)[0]}")).scenes.values()
    )
    suite = Suite(dataset=address, completers=["plane_fitting"], tasks=["chamfer"])
    assert requests(suite, folder)[0].dataset == address
