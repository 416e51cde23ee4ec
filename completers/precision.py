"""Which precision networks run in on this processor."""

from __future__ import annotations

import torch


def bfloat16_pays() -> bool:
    """Whether this processor multiplies bfloat16 matrices faster than float32: with AMX four times, else slower."""
    return torch.cpu._is_amx_tile_supported()
