"""Weights from the network: used only if their digest matches, kept by it, and never fetched unasked."""

import hashlib
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save

from pcdbench.downloads import downloaded, is_address
from pcdbench.errors import PcdbenchError
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
    assert is_address("HTTPS://a/b") and is_address("http://a")
    assert not any(map(is_address, ("", "weights.safetensors", "/https://a", "ftp://a/b", "file:///etc/passwd")))
