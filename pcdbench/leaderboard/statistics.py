"""Statistics of samples that come in scenes: quantiles and means with bootstrap intervals over scenes.

Samples of one scene (its draws, locations, steps, objects) are not independent of one another, scenes are:
a bootstrap draws scenes with replacement and takes all samples of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

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
    weights = scene_weights(count)
    sums = np.bincount(scenes, samples, minlength=count)
    sizes = np.bincount(scenes, minlength=count)
    drawn = {
        "median": _resampled_quantile(samples, scenes, weights, 0.5),
        "p90": _resampled_quantile(samples, scenes, weights, 0.9),
        "mean": (weights @ sums) / (weights @ sizes),
    }
    return {name: _estimate(float(value), drawn[name]) for name, value in values.items()}


def mean_estimate(samples: NDArray[np.float64], scenes: NDArray[np.int64]) -> Estimate:
    """The mean of samples with its 95 % interval over scenes; arguments as of `estimates`."""
    _, scenes = np.unique(scenes, return_inverse=True)
    value = float(np.mean(samples))
    count = int(scenes.max()) + 1
    if count < 2:
        return Estimate(value, np.nan, np.nan)
    weights = scene_weights(count)
    return _estimate(value, (weights @ np.bincount(scenes, samples)) / (weights @ np.bincount(scenes)))


@lru_cache(maxsize=8)
def scene_weights(count: int, resamples: int = RESAMPLES) -> NDArray[np.int32]:
    """(resamples, count) how often each scene is in each resample; the same for all that have these scenes."""
    drawn = np.random.default_rng(_SEED).multinomial(count, np.full(count, 1 / count), size=resamples)
    return drawn.astype(np.int32)


def _resampled_quantile(ordered: NDArray, scenes: NDArray, weights: NDArray, share: float) -> NDArray[np.float64]:
    """(R,) numpy's linear quantile of each resample of `ordered` (n,); weights (R, S) say how often a scene is in."""
    total = weights @ np.bincount(scenes)
    position = (total - 1) * share
    below = np.floor(position).astype(np.int64)
    low = ordered[_index_of_rank(scenes, weights, below)]
    high = ordered[_index_of_rank(scenes, weights, np.minimum(below + 1, total - 1))]
    return low + (position - below) * (high - low)


def _index_of_rank(scenes: NDArray, weights: NDArray, ranks: NDArray[np.int64]) -> NDArray[np.int64]:
    """(R,) where in the order of samples each resample has the sample of this rank.

    Blocks of samples are counted first, by one matrix product, and single samples in the one block that
    matters: sqrt(n) steps a resample and not n.
    """
    count, size = len(scenes), int(np.ceil(np.sqrt(len(scenes))))
    blocks = -(-count // size)
    per_block = np.bincount(np.arange(count) // size * weights.shape[1] + scenes, minlength=blocks * weights.shape[1])
    ends = np.cumsum(weights.astype(float) @ per_block.reshape(blocks, -1).T, axis=1)
    block = (ends <= ranks[:, None]).sum(axis=1)
    rows = np.arange(len(weights))
    before = np.where(block > 0, ends[rows, block - 1], 0.0)
    index = block[:, None] * size + np.arange(size)
    times = np.where(index < count, weights[rows[:, None], scenes[np.minimum(index, count - 1)]], 0)
    inside = before[:, None] + np.cumsum(times, axis=1)
    return block * size + (inside <= ranks[:, None]).sum(axis=1)


def _estimate(value: float, drawn: NDArray[np.float64]) -> Estimate:
    low, high = np.quantile(drawn, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Estimate(value, float(low), float(high))
