"""Files from the network: only where the user names one with its digest, and used only if it is that file."""

from __future__ import annotations

import re
from pathlib import Path

from pcdbench.errors import PcdbenchError
from pcdbench.paths import cache_dir

_ADDRESS = re.compile(r"https?://", re.IGNORECASE)
_DIGEST = re.compile(r"sha256=([0-9a-f]{64})", re.IGNORECASE)
_TIMEOUT_S = 30.0


def is_address(text: str) -> bool:
    """Whether a text names a file on the network and not one on disk."""
    return bool(_ADDRESS.match(text))


def downloaded(address: str) -> Path:
    """The file at `https://.../name#sha256=DIGEST`, kept in the cache folder by its digest.

    It is hashed each time: one that was changed on disk is fetched anew.

    Raises:
        PcdbenchError: where the address has no digest, cannot be reached, or holds another file.
    """
    url, _, fragment = address.partition("#")
    digest = _DIGEST.fullmatch(fragment)
    if digest is None:
        raise PcdbenchError(f"{address} needs the file's digest, without which nothing is used: URL#sha256=<64 digits>")
    import pooch

    pooch.get_logger().setLevel("WARNING")
    name = digest[1].lower() + Path(url.partition("?")[0]).suffix[:20]
    try:
        found = pooch.retrieve(
            url,
            known_hash=f"sha256:{digest[1].lower()}",
            fname=re.sub(r"[^A-Za-z0-9.]", "_", name),
            path=cache_dir() / "downloads",
            downloader=pooch.HTTPDownloader(timeout=_TIMEOUT_S),
        )
    except ValueError as error:
        reason = "is not the file of that digest" if "hash" in str(error) else f"cannot be used ({error})"
        raise PcdbenchError(f"{url} {reason}; nothing of it is kept: check address and digest") from None
    except OSError as error:
        reason = " ".join(str(error).split())[:200]
        raise PcdbenchError(f"{url} cannot be downloaded ({reason}); check it and try again, or give a file") from None
    return Path(found)
