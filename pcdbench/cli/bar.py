"""A bar for work that takes a while, where somebody looks on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeVar

T = TypeVar("T")


def with_bar(items: Sequence[T], what: str) -> Iterable[T]:
    """The items one by one; on a terminal, with a bar on standard error while it lasts."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    return track(items, what, console=console, transient=True, disable=not console.is_terminal)
