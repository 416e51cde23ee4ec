"""The environments by number: which kind each is, and how it is drawn."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pcdbench.datasets.synthetic.building import build
from pcdbench.datasets.synthetic.environment import Environment
from pcdbench.datasets.synthetic.furnishing import furnished
from pcdbench.datasets.synthetic.layouts import LARGE_KINDS, SMALL_KINDS, plan_of
from pcdbench.keys import seed_from

VERSION = "3"
SEEDS = "1"  # The version whose environments these are: 2 mended single crops, 3 surveys all of them anew.


def kind_of(index: int) -> str:
    """Of what kind environment `index` is: even ones are large, odd ones small."""
    kinds = LARGE_KINDS if index % 2 == 0 else SMALL_KINDS
    return kinds[(index // 2) % len(kinds)]


@lru_cache(maxsize=2)
def environment(index: int, stream: str = "benchmark") -> Environment:
    """Environment `index` of a stream, the same on every machine.

    Args:
        index: 0 to 49 are the benchmark's; any number of the `train` stream.
        stream: `benchmark` or `train`: their seeds never meet.
    """
    rng = np.random.default_rng(seed_from("indoor", SEEDS, stream, index))
    kind = kind_of(index)
    plan = plan_of(kind, rng)
    building = build(plan, rng)
    name = f"env{index:03d}" if stream == "benchmark" else f"{stream}{index:06d}"
    return furnished(name, plan, building, rng)
