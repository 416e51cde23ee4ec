"""Ranks of completers: who is shown to be better than whom, and who cannot be told apart.

In one table (one task's main metric, of one data set, incompleteness and level) every pair of completers is compared
by a bootstrap over scenes that is paired: each resample holds the same cases of both. The statistic is the
metric's own, the median or the mean that the table shows. All pairs are judged at once: the intervals are those of
the largest studentised difference over all pairs (Romano and Wolf 2005, "Stepwise multiple testing as formalized
data snooping", its single step), so that in 95 % of the tables not one pair is told apart wrongly. Few scenes widen
them as Student's t does (Hesterberg 2015, "What teachers should know about the bootstrap").

A completer's rank is 1 + the number of completers shown to be better. Who cannot be told apart from the best is
first with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from pcdbench.leaderboard.statistics import CONFIDENCE, Estimate, resampled

# With fewer scenes even a sign test of differences that all agree does not reach 95 % (2 * 0.5^5 > 0.05).
FEWEST_SCENES = 6
# A thousand times what adding up thousands of samples rounds, as a share of the sum.
_ROUNDING = 1e-11


@dataclass(frozen=True)
class Tried:
    """How a completer fared in a case: its samples; empty where it failed, timed out or was skipped."""

    case: int
    scene: str
    samples: Sequence[float]


@dataclass(frozen=True)
class PairedDifference:
    """The statistic of `first` less that of `second` over the same cases; `better` is None where that is open."""

    first: str
    second: str
    difference: Estimate
    cases: int
    better: str | None


@dataclass(frozen=True)
class Ranking:
    """Ranks by completer, and the comparisons they come from."""

    ranks: Mapping[str, int]
    differences: tuple[PairedDifference, ...]


def ranking(
    tried: Mapping[str, Sequence[Tried]],
    references: Mapping[str, Sequence[Tried]],
    direction: Literal["lower", "higher"],
    statistic: Literal["median", "mean"],
) -> Ranking:
    """Rank completers over the cases that all of them were tried on.

    A case in which a completer has no samples though another one has (it failed, timed out or was skipped) counts
    with the worst sample that anyone, references included, has in this table. So nobody gains by failing where
    it is hard. Cases in which no completer has samples do not count; a completer without a single sample has no rank.

    Args:
        tried: by completer, its cases.
        references: likewise; they are not ranked.
    """
    tried = {name: its for name, its in tried.items() if any(len(one.samples) for one in its)}
    if not tried:
        return Ranking({}, ())
    names = list(tried)
    samples, scenes, cases = _filled(tried, references, direction)
    if not cases:
        return Ranking({}, ())
    values = np.array([_value(samples[name], statistic) for name in names])
    count = len(np.unique(scenes[names[0]]))
    pairs = list(combinations(range(len(names)), 2))
    halves = np.full(len(pairs), np.nan)
    if count >= FEWEST_SCENES and pairs:
        drawn = np.array([resampled(samples[name], scenes[name], statistic) for name in names])
        halves = _simultaneous_half_widths(drawn, values, pairs, count)
    differences = []
    better_than: dict[str, set[str]] = {name: set() for name in names}
    for (first, second), half in zip(pairs, halves, strict=True):
        value = values[first] - values[second]
        better = None
        if abs(value) > half:
            wins_first = (value < 0) == (direction == "lower")
            better, worse = (names[first], names[second]) if wins_first else (names[second], names[first])
            better_than[worse].add(better)
        estimate = Estimate(float(value), float(value - half), float(value + half))
        differences.append(PairedDifference(names[first], names[second], estimate, cases, better))
    return Ranking({name: 1 + len(better_than[name]) for name in names}, tuple(differences))


def _simultaneous_half_widths(
    drawn: NDArray[np.float64], values: NDArray[np.float64], pairs: Sequence[tuple[int, int]], scenes: int
) -> NDArray[np.float64]:
    """(P,) half the width of each pair's interval, such that all P hold at once; drawn (C, R), values (C,)."""
    first, second = np.array(pairs).T
    size = np.abs(drawn).max(axis=1)
    # Differences that are the same in every resample differ by rounding alone, which must not count as a movement.
    least = np.maximum(_ROUNDING * np.maximum(size[first], size[second]), np.finfo(float).tiny)
    spread = np.maximum((drawn[first] - drawn[second]).std(axis=1), least)
    moved = np.abs((drawn[first] - drawn[second]) - (values[first] - values[second])[:, None])
    critical = np.quantile((moved / spread[:, None]).max(axis=0), CONFIDENCE)
    # A bootstrap's spread is that of n scenes about their own mean, and its tails are those of many scenes.
    narrow = np.sqrt(scenes / (scenes - 1))
    tails = t.ppf((1 + CONFIDENCE) / 2, scenes - 1) / norm.ppf((1 + CONFIDENCE) / 2)
    return critical * spread * narrow * tails


def _filled(
    tried: Mapping[str, Sequence[Tried]],
    references: Mapping[str, Sequence[Tried]],
    direction: Literal["lower", "higher"],
) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.int64]], int]:
    """Samples and scenes of each completer over the common cases, the lost ones filled; how many cases that are."""
    by_case = {name: {one.case: one for one in its} for name, its in tried.items()}
    common = sorted(set.intersection(*(set(cases) for cases in by_case.values())))
    sizes = {case: max(len(cases[case].samples) for cases in by_case.values()) for case in common}
    counted = [case for case in common if sizes[case]]
    everything = np.concatenate(
        [np.asarray(one.samples, float) for its in (*tried.values(), *references.values()) for one in its]
    )
    worst = everything.max() if direction == "lower" else everything.min()
    scene_number = {scene: number for number, scene in enumerate(sorted({_scene(by_case, case) for case in counted}))}
    samples, scenes = {}, {}
    for name, cases in by_case.items():
        parts = [np.asarray(cases[case].samples or [worst] * sizes[case], float) for case in counted]
        samples[name] = np.concatenate(parts) if parts else np.empty(0)
        scenes[name] = np.repeat(
            [scene_number[_scene(by_case, case)] for case in counted], [len(part) for part in parts]
        ).astype(np.int64)
    return samples, scenes, len(counted)


def _scene(by_case: Mapping[str, Mapping[int, Tried]], case: int) -> str:
    return next(iter(by_case.values()))[case].scene


def _value(samples: NDArray[np.float64], statistic: Literal["median", "mean"]) -> float:
    return float(np.median(samples) if statistic == "median" else samples.mean())
