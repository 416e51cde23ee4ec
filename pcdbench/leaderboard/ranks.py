"""Ranks of completers: who is shown to be better than whom, and who cannot be told apart.

In one table (one task's main metric, of one data set, incompleteness and level) every pair of completers is compared
by a bootstrap over scenes that is paired: each resample holds the same cases of both, those that both were tried on.
So who was tried on little takes nothing from what is known of the others. The statistic is the
metric's own, the median or the mean that the table shows. All pairs are judged at once: the intervals are those of
the largest studentised difference over all pairs (Romano and Wolf 2005, "Stepwise multiple testing as formalized
data snooping", its single step), so that in 95 % of the tables not one pair is told apart wrongly. Few scenes widen
them as Student's t does (Hesterberg 2015, "What teachers should know about the bootstrap"), as far out in its tails as
the largest of all pairs is; docs/leaderboards.md has how often it still goes wrong.

A completer's rank is 1 + the number of completers shown to be better, by those that were tried on all that it was
tried on: cases where one is good can be chosen. Who cannot be told apart from the best is first with it, unless it has
values of fewer cases: few cases and filled ones make intervals wide, and nobody should come first by that.
"""

from __future__ import annotations

from collections import defaultdict
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
    """How a completer fared in a case: its samples; empty where it failed, timed out or was skipped.

    `scene` is what cases are independent by: scenes of one environment are one.
    """

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
    """Rank completers, each two over the cases that both were tried on.

    A case in which a completer has no samples though another one has (it failed, timed out or was skipped) counts
    with the worst sample that anyone, references included, has in this table; and of two that cannot be told apart,
    or of which the better one was not tried on all that the other was, the one with fewer cases comes after the other.
    So nobody gains by failing where it is hard, or by leaving it out. Cases in which no
    completer has samples do not count; a completer without a single sample has no rank, nor has one with fewer than
    `FEWEST_SCENES` scenes in common with every other, where others have more.

    Args:
        tried: by completer, its cases.
        references: likewise; they are not ranked.
    """
    tried = {name: its for name, its in tried.items() if any(len(one.samples) for one in its)}
    if len(tried) < 2:
        return Ranking(dict.fromkeys(tried, 1), ())
    table = _Table(tried, references, direction)
    together: dict[tuple[int, ...], list[tuple[str, str]]] = defaultdict(list)
    for pair in combinations(tried, 2):
        together[table.common(*pair)].append(pair)
    groups = [_compared(table, cases, pairs, statistic) for cases, pairs in together.items() if cases]
    compared = [one for group in groups for one in group]
    critical = _critical(groups)
    found = {}
    before: dict[str, set[str]] = {name: set() for name in tried}
    for one in compared:
        half = one.half_width(critical)
        better = None
        if abs(one.value) > half:
            wins_first = (one.value < 0) == (direction == "lower")
            better, worse = (one.first, one.second) if wins_first else (one.second, one.first)
        if better is not None and not table.left_out(better, worse):
            before[worse].add(better)
        elif table.measured[one.first] != table.measured[one.second]:
            more, fewer = sorted((one.first, one.second), key=table.measured.__getitem__, reverse=True)
            before[fewer].add(more)
        estimate = Estimate(one.value, one.value - half, one.value + half)
        found[one.first, one.second] = PairedDifference(one.first, one.second, estimate, one.cases, better)
    enough = min(FEWEST_SCENES, max((one.scenes for one in compared), default=0))
    ranked = {name for one in compared if one.scenes >= enough for name in (one.first, one.second)}
    ranks = {name: 1 + len(its) for name, its in before.items() if name in ranked}
    return Ranking(ranks, tuple(found[pair] for pair in combinations(tried, 2) if pair in found))


@dataclass(frozen=True)
class _Compared:
    """Two completers over their common cases.

    Attributes:
        value: the statistic of the first less that of the second.
        spread: of that over resamples; NaN with fewer than `FEWEST_SCENES`.
        moved: (R,) how many spreads it is off in each resample.
    """

    first: str
    second: str
    cases: int
    scenes: int
    value: float
    spread: float
    moved: NDArray[np.float64] | None

    def half_width(self, critical: float) -> float:
        """Half the width of the interval that reaches `critical` spreads, a little more for few scenes."""
        if self.moved is None:
            return np.nan
        # A bootstrap's spread is that of n scenes about their own mean, and its tails are those of many scenes: as far
        # out as the largest of many pairs reaches, Student's are far longer than where 95 % of one pair end.
        narrow = np.sqrt(self.scenes / (self.scenes - 1))
        return float(self.spread * narrow * t.isf(norm.sf(critical), self.scenes - 1))


def _compared(
    table: _Table, cases: Sequence[int], pairs: Sequence[tuple[str, str]], statistic: Literal["median", "mean"]
) -> list[_Compared]:
    """These pairs over the cases that are common to each of them."""
    names = list(dict.fromkeys(name for pair in pairs for name in pair))
    filled = {name: table.filled(name, cases) for name in names}
    value = {name: _value(samples, statistic) for name, (samples, _) in filled.items()}
    scenes = len(np.unique(filled[names[0]][1]))
    if scenes < FEWEST_SCENES:
        return [
            _Compared(first, second, len(cases), scenes, value[first] - value[second], np.nan, None)
            for first, second in pairs
        ]
    drawn = {name: resampled(*filled[name], statistic) for name in names}
    size = {name: np.abs(its).max() for name, its in drawn.items()}
    found = []
    for first, second in pairs:
        differences, difference = drawn[first] - drawn[second], value[first] - value[second]
        # Differences that are the same in every resample differ by rounding alone, which must not count as a movement.
        least = max(_ROUNDING * max(size[first], size[second]), np.finfo(float).tiny)
        spread = max(differences.std(), least)
        moved = np.abs(differences - difference) / spread
        found.append(_Compared(first, second, len(cases), scenes, difference, float(spread), moved))
    return found


def _critical(groups: Sequence[Sequence[_Compared]]) -> float:
    """How many spreads the interval of each pair reaches, such that all hold at once; NaN where there is none.

    Groups of pairs with other cases are taken as independent: that makes intervals wider, never narrower (Sidak 1967).
    """
    # Resamples of as many scenes draw the same places, whichever scenes these are: shuffled, groups share nothing.
    shuffle = np.random.default_rng(0).permutation
    moved = [[one.moved for one in group if one.moved is not None] for group in groups]
    largest = [shuffle(np.max(its, axis=0)) for its in moved if its]
    return float(np.quantile(np.max(largest, axis=0), CONFIDENCE)) if largest else np.nan


class _Table:
    """Who was tried on what, and what counts where samples were lost.

    Attributes:
        measured: by completer, the number of cases that it has samples of.
    """

    def __init__(
        self,
        tried: Mapping[str, Sequence[Tried]],
        references: Mapping[str, Sequence[Tried]],
        direction: Literal["lower", "higher"],
    ) -> None:
        self._by_case = {name: {one.case: one for one in its} for name, its in tried.items()}
        self.measured = {name: sum(len(one.samples) > 0 for one in its) for name, its in tried.items()}
        self._size: dict[int, int] = defaultdict(int)
        for its in tried.values():
            for one in its:
                self._size[one.case] = max(self._size[one.case], len(one.samples))
        everything = np.concatenate(
            [np.asarray(one.samples, float) for its in (*tried.values(), *references.values()) for one in its]
        )
        self._worst = everything.max() if direction == "lower" else everything.min()

    def left_out(self, name: str, other: str) -> bool:
        """Whether the other was tried on cases that anyone has samples of, and this one was not."""
        return any(self._size[case] for case in self._by_case[other].keys() - self._by_case[name].keys())

    def common(self, first: str, second: str) -> tuple[int, ...]:
        """The cases that both were tried on and that anyone has samples of."""
        both = self._by_case[first].keys() & self._by_case[second].keys()
        return tuple(sorted(case for case in both if self._size[case]))

    def filled(self, name: str, cases: Sequence[int]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Samples of a completer in these cases, the lost ones filled, and which scene each belongs to."""
        its = [self._by_case[name][case] for case in cases]
        number = {scene: number for number, scene in enumerate(sorted({one.scene for one in its}))}
        parts = [np.asarray(one.samples or [self._worst] * self._size[one.case], float) for one in its]
        scenes = np.repeat([number[one.scene] for one in its], [len(part) for part in parts]).astype(np.int64)
        return np.concatenate(parts), scenes


def _value(samples: NDArray[np.float64], statistic: Literal["median", "mean"]) -> float:
    return float(np.median(samples) if statistic == "median" else samples.mean())
