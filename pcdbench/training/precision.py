"""Which precision networks run in on this machine."""

from __future__ import annotations

import torch


def bfloat16_pays(device: str = "cpu") -> bool:
    """Whether matrices multiply faster in bfloat16 than in float32: on GPUs, and on processors that compute in it.

    Those with AMX are four times as fast in it, those with AVX512-BF16 two and a half times, all others three times
    slower (measured).

    Args:
        device: `cpu`, `cuda`, or `auto`: a GPU where there is one.
    """
    if device != "cpu" and torch.cuda.is_available():
        return True
    return torch.cpu._is_amx_tile_supported() or torch.cpu._is_avx512_bf16_supported()
