"""Files from elsewhere: only where the user names one with its digest, and used only if it is that file."""

from __future__ import annotations

import hashlib
import re
import tempfile
from pathlib import Path

from pcdbench.errors import PcdbenchError
from pcdbench.keys import file_digest
from pcdbench.paths import cache_dir

# A single letter is a drive of Windows.
_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)
_HTTP = re.compile(r"https?://", re.IGNORECASE)
_DIGEST = re.compile(r"sha256=([0-9a-f]{64})", re.IGNORECASE)
_TIMEOUT_S = 30.0
_BLOCK_BYTES = 1 << 20


def is_address(text: str) -> bool:
    """Whether a text names a file by a URL and not by a path."""
    return bool(_ADDRESS.match(text))


def downloaded(address: str) -> Path:
    """The file at `PROTOCOL://.../name#sha256=DIGEST`, kept in the cache folder by its digest.

    The protocol is http, https or another one of fsspec (s3, gs, ssh, ...). The kept file is hashed each time: one
    that was changed on disk is fetched anew.

    Raises:
        PcdbenchError: where the address has no digest, cannot be read, or holds another file.
    """
    url, digest, kept = _parsed(address)
    fetch = _fetch_by_http if _HTTP.match(url) else _fetch_by_fsspec
    fetch(url, digest, kept)
    return kept


def kept_download(address: str) -> Path | None:
    """The file at an address if it has been fetched already; None where it has not.

    Raises:
        PcdbenchError: where the address has no digest.
    """
    _, digest, kept = _parsed(address)
    return kept if kept.is_file() and file_digest(kept) == digest else None


def _parsed(address: str) -> tuple[str, str, Path]:
    """The URL, the digest, and where its file is kept."""
    url, _, fragment = address.rpartition("#")
    found = _DIGEST.fullmatch(fragment)
    if found is None:
        raise PcdbenchError(f"{address} needs the file's digest, without which nothing is used: URL#sha256=<64 digits>")
    digest = found[1].lower()
    # In zip://room.ply::s3://bucket/rooms.zip the file is the first.
    suffix = Path(re.split(r"::|\?", url)[0]).suffix[:20]
    return url, digest, cache_dir() / "downloads" / re.sub(r"[^A-Za-z0-9.]", "_", digest + suffix)


def _fetch_by_http(url: str, digest: str, kept: Path) -> None:
    import pooch

    pooch.get_logger().setLevel("WARNING")
    try:
        pooch.retrieve(
            url,
            known_hash=f"sha256:{digest}",
            fname=kept.name,
            path=kept.parent,
            downloader=pooch.HTTPDownloader(timeout=_TIMEOUT_S),
        )
    except ValueError as error:
        raise _other_file(url) if "hash" in str(error) else _unusable(url, "used", error) from None
    except OSError as error:
        raise _unusable(url, "downloaded", error) from None


def _fetch_by_fsspec(url: str, digest: str, kept: Path) -> None:
    import fsspec

    if kept.is_file() and file_digest(kept) == digest:
        return
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=kept.parent) as folder:
            copy, hashed = Path(folder, "copy"), hashlib.sha256()
            with fsspec.open(url, "rb") as source, copy.open("wb") as target:
                while block := source.read(_BLOCK_BYTES):
                    hashed.update(block)
                    target.write(block)
            same = hashed.hexdigest() == digest
            if same:
                copy.replace(kept)
    # Each protocol's package has errors of its own.
    except Exception as error:
        raise _unusable(url, "read", error) from None
    if not same:
        raise _other_file(url)


def _other_file(url: str) -> PcdbenchError:
    return PcdbenchError(f"{url} is not the file of that digest; nothing of it is kept: check address and digest")


def _unusable(url: str, done: str, error: Exception) -> PcdbenchError:
    reason = "there is no such file" if isinstance(error, FileNotFoundError) else " ".join(str(error).split())[:200]
    return PcdbenchError(
        f"{url} cannot be {done} ({reason or type(error).__name__}); check it and try again, or give a file on disk"
    )
