"""Measures how often intervals hold what they are of, and how often alike completers are told apart.

`python docs/measure_intervals.py [TABLES]`: scenes and completers are made up, 600 of each kind unless given. About
three minutes on one core.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pcdbench.leaderboard.ranks import Tried, ranking
from pcdbench.leaderboard.statistics import estimates

TABLES = 600
COMPLETERS = 8
SCENES = (6, 12, 18, 30, 150)
Samples = NDArray[np.float64]
"""(scenes, samples of one scene)."""


def even(rng: np.random.Generator, scenes: int) -> list[Samples]:
    """Errors about a scene's own, as often above as below: normal."""
    difficulty = rng.normal(size=(scenes, 1))
    return [difficulty + rng.normal(scale=0.3, size=(scenes, 1)) for _ in range(COMPLETERS)]


def skewed(rng: np.random.Generator, scenes: int) -> list[Samples]:
    """Errors in proportion to a scene's own, which is large in few."""
    difficulty = rng.gamma(1.0, size=(scenes, 1))
    return [difficulty * np.exp(rng.normal(scale=0.3, size=(scenes, 1))) for _ in range(COMPLETERS)]


def found_or_lost(rng: np.random.Generator, scenes: int) -> list[Samples]:
    """Ten locations a scene, found to 5 mm or lost by 0.3 to 1.5 m, more often in some scenes."""
    lost = 1 / (1 + np.exp(1 - rng.normal(size=(scenes, 1))))
    return [
        np.where(rng.random((scenes, 10)) < lost, rng.uniform(0.3, 1.5, (scenes, 10)), 0.005) for _ in range(COMPLETERS)
    ]


KINDS: tuple[Callable[[np.random.Generator, int], list[Samples]], ...] = (even, skewed, found_or_lost)


def told_apart(made: list[Samples], statistic: Literal["median", "mean"]) -> bool:
    """Whether any two of these completers are."""
    tried = {
        f"completer {number}": [Tried(at, f"scene {at:03}", tuple(its)) for at, its in enumerate(samples)]
        for number, samples in enumerate(made)
    }
    return any(its.better for its in ranking(tried, {}, "lower", statistic).differences)


def main(tables: int) -> None:
    for kind in KINDS:
        many = np.concatenate([its.ravel() for its in kind(np.random.default_rng(0), 100_000)])
        truth = {"median": np.median(many), "p90": np.quantile(many, 0.9), "mean": many.mean()}
        for scenes in SCENES:
            rng = np.random.default_rng(1)
            wrong = {"median": 0, "mean": 0}
            holds = dict.fromkeys(truth, 0)
            for _ in range(tables):
                made = kind(rng, scenes)
                wrong["median"] += told_apart(made, "median")
                wrong["mean"] += told_apart(made, "mean")
                one = made[0]
                for name, its in estimates(one.ravel(), np.repeat(np.arange(scenes), one.shape[1])).items():
                    holds[name] += bool(its.low <= truth[name] <= its.high)
            apart = ", ".join(f"{name} {1 - its / tables:.1%}" for name, its in wrong.items())
            held = ", ".join(f"{name} {its / tables:.1%}" for name, its in holds.items())
            print(f"{kind.__name__}, {scenes} scenes: no pair told apart: {apart}; intervals that hold: {held}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else TABLES)
