"""The confidence of a proposed point: what was observed around it, who agrees, and what its completer says itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FACTORS = ("distance", "agreement", "enclosure", "opinions", "completer")


def factors(
    evidence: NDArray[np.float64],
    seconded: NDArray[np.int64],
    asked: NDArray[np.int64],
    own: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(K, 5) in [0, 1], in the order of `FACTORS`; their product is the confidence.

    An opinion is another run on the same tile, or a neighbouring tile whose window holds the place; the proposal
    itself is one in favour: (1 + seconded) / (1 + asked).

    Args:
        evidence: (K, 3) factors of distance, agreement and enclosure.
        seconded: (K,) how many others put a point there too.
        asked: (K,) how many others there were.
        own: (K,) in [0, 1], the completer's own confidence, 1 where it has none.
    """
    return np.column_stack([evidence, (1 + seconded) / (1 + asked), own])
