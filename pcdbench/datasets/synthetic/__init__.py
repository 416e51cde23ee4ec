"""The generated data set `indoor`; importing this package costs nothing until `Indoor` is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pcdbench.datasets.synthetic.indoor import Indoor

__all__ = ["Indoor"]


def __getattr__(name: str) -> Any:
    if name == "Indoor":
        from pcdbench.datasets.synthetic.indoor import Indoor

        return Indoor
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
