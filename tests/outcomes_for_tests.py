"""What came out of runs, to compare them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

# They say where and how fast a row was computed, and may differ between two rows of one key.
_CIRCUMSTANCES = ("completing", "evaluating", "device", "threads", "host", "time", "detail", "output")


def outcomes(rows: Iterable[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Rows by key, without what may differ between machines."""
    return {row["key"]: {name: value for name, value in row.items() if name not in _CIRCUMSTANCES} for row in rows}
