"""Digests and seeds: what decides an outcome is hashed, and randomness comes from the hash, never from order."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

# One encoder for all: making it costs more than most texts.
_encoded = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode


def canonical_json(value: Any) -> str:
    """The one JSON text of a value: sorted keys, no spaces, no NaN."""
    return _encoded(value)


def digest(value: Any) -> str:
    """SHA-256 (hex) of a JSON-like value; equal values have equal digests on every machine.

    Paths that are not UTF-8 have digests too, though their texts hold lone surrogates.
    """
    return hashlib.sha256(canonical_json(value).encode("utf-8", "surrogatepass")).hexdigest()


def seed_from(*parts: Any) -> int:
    """A 63-bit seed decided by `parts` alone, for `numpy.random.default_rng`."""
    return int(digest(list(parts))[:16], 16) >> 1


def file_digest(path: Path) -> str:
    """SHA-256 (hex) of a file's bytes, read in pieces."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
