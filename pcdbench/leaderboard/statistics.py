"""Statistics of samples that come in scenes: quantiles and means with bootstrap intervals over scenes.

Samples of one scene (its draws, locations, steps, objects) are not independent of one another, scenes are:
a bootstrap draws scenes with replacement and takes all samples of each. Scenes that are parts of one environment
(`Dataset.environment`) are drawn together, as one: they have surface in common.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

RESAMPLES = 1000
CONFIDENCE = 0.95
_SEED = 20220901


@dataclass(frozen=True)
class Estimate:
    """A statistic and its bootstrap interval; the interval is NaN where there are fewer than two scenes."""

    value: float
    low: float
    high: float

    @property
    def has_interval(self) -> bool:
        return bool(np.isfinite(self.low))


def estimates(samples: NDArray[np.float64], scenes: NDArray[np.int64]) -> Mapping[str, Estimate]:
    """Median, 90th percentile and mean of samples, each with its 95 % interval over scenes.

    Args:
        samples: (n,) all samples of all scenes, at least one.
        scenes: (n,) which scene each belongs to, counted from 0.
    """
    order = np.argsort(samples, kind="stable")
    samples, scenes = samples[order], scenes[order]
    _, scenes = np.unique(scenes, return_inverse=True)
    values = {"median": np.median(samples), "p90": np.quantile(samples, 0.9), "mean": samples.mean()}
    count = int(scenes.max()) + 1
    if count < 2:
        return {name: Estimate(float(value), np.nan, np.nan) for name, value in values.items()}
    median, p90 = _resampled_quantiles(samples, scenes, count, (0.5, 0.9))
    drawn = {"median": median, "p90": p90, "mean": _resampled_means(samples, scenes, count)}
    return {name: _estimate(float(value), drawn[name]) for name, value in values.items()}


def mean_estimate(samples: NDArray[np.float64], scenes: NDArray[np.int64]) -> Estimate:
    """The mean of samples with its 95 % interval over scenes; arguments as of `estimates`."""
    _, scenes = np.unique(scenes, return_inverse=True)
    value = float(np.mean(samples))
    count = int(scenes.max()) + 1
    if count < 2:
        return Estimate(value, np.nan, np.nan)
    return _estimate(value, _resampled_means(samples, scenes, count))


def resampled(
    samples: NDArray[np.float64], scenes: NDArray[np.int64], statistic: Literal["median", "mean"]
) -> NDArray[np.float64]:
    """(RESAMPLES,) a statistic of each resample; arguments as of `estimates`, with at least two scenes.

    Resample r draws the same scenes whatever is measured: differences of two completers' are paired.
    """
    order = np.argsort(samples, kind="stable")
    samples, (_, scenes) = samples[order], np.unique(scenes[order], return_inverse=True)
    count = int(scenes.max()) + 1
    if statistic == "mean":
        return _resampled_means(samples, scenes, count)
    return _resampled_quantiles(samples, scenes, count, (0.5,))[0]


@lru_cache(maxsize=8)
def scene_weights(count: int) -> NDArray[np.int32]:
    """(RESAMPLES, count) how often each scene is in each resample; the same for all that have these scenes."""
    drawn = np.random.default_rng(_SEED).multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
    return drawn.astype(np.int32)


@lru_cache(maxsize=2)
def _float_weights(count: int) -> NDArray[np.float64]:
    """`scene_weights` for products with sums."""
    return scene_weights(count).astype(np.float64)


@lru_cache(maxsize=2)
def _weights_by_scene(count: int) -> NDArray[np.int16]:
    """(count, RESAMPLES) `scene_weights` with each scene's in one piece, for adding up those of many samples."""
    return np.ascontiguousarray(scene_weights(count).T.astype(np.int16))


def _resampled_means(samples: NDArray[np.float64], scenes: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """(R,) the mean of each resample; scenes are counted from 0 to `count` without a gap."""
    weights = _float_weights(count)
    return (weights @ np.bincount(scenes, samples)) / (weights @ np.bincount(scenes).astype(np.float64))


def _resampled_quantiles(
    ordered: NDArray[np.float64], scenes: NDArray[np.int64], count: int, shares: Sequence[float]
) -> list[NDArray[np.float64]]:
    """For each share, (R,) numpy's linear quantile of each resample of `ordered` (n,)."""
    counted = _CountedBlocks(scenes, count)
    drawn = []
    for share in shares:
        position = (counted.total - 1) * share
        below = np.floor(position).astype(np.int64)
        low = ordered[counted.index_of_rank(below)]
        high = ordered[counted.index_of_rank(np.minimum(below + 1, counted.total - 1))]
        drawn.append(low + (position - below) * (high - low))
    return drawn


class _CountedBlocks:
    """How many samples each resample has of each block of consecutive samples.

    Finding a sample by its rank then takes a look at the blocks and at the samples of one of them:
    sqrt(n) steps a resample and not n.
    """

    def __init__(self, scenes: NDArray[np.int64], count: int) -> None:
        self._scenes = scenes
        self._weights = _weights_by_scene(count)
        # Looking at samples costs more than looking at blocks; sixteen bits hold what a block adds up to.
        self._size = min(int(np.ceil(np.sqrt(len(scenes)) / 2)), (2**15 - 1) // int(self._weights.max()))
        counts = [
            self._weights[scenes[start : start + self._size]].sum(axis=0, dtype=np.int16)
            for start in range(0, len(scenes), self._size)
        ]
        self._ends: NDArray[np.int32] = np.cumsum(counts, axis=0, dtype=np.int32)
        self.total: NDArray[np.int64] = self._ends[-1].astype(np.int64)

    def index_of_rank(self, ranks: NDArray[np.int64]) -> NDArray[np.int64]:
        """(R,) where in the order of samples each resample has the sample of this rank."""
        ranks = ranks.astype(np.int32)
        resamples = np.arange(len(ranks))
        block = (self._ends <= ranks).sum(axis=0)
        start = block * self._size
        rank_inside = ranks - np.where(block > 0, self._ends[block - 1, resamples], 0)
        index = np.minimum(start + np.arange(self._size)[:, None], len(self._scenes) - 1)
        times = self._weights.ravel()[self._scenes[index] * len(ranks) + resamples]
        # Beyond the last sample it is repeated, which adds only to counts that are past the rank already.
        return start + (np.cumsum(times, axis=0, dtype=np.int16) <= rank_inside).sum(axis=0)


def _estimate(value: float, drawn: NDArray[np.float64]) -> Estimate:
    low, high = np.quantile(drawn, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Estimate(value, float(low), float(high))
