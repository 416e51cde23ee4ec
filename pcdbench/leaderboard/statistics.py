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
    ends = np.cumsum(weights[:, scenes], axis=1, dtype=np.int64)
    drawn = {
        "median": _weighted_quantile(samples, ends, 0.5),
        "p90": _weighted_quantile(samples, ends, 0.9),
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


def _weighted_quantile(ordered: NDArray, ends: NDArray[np.int64], share: float) -> NDArray[np.float64]:
    """(R,) numpy's linear quantile of `ordered` (n,) where each value is repeated, `ends` (R, n) counting up."""
    total = ends[:, -1]
    position = (total - 1) * share
    below = np.floor(position).astype(np.int64)
    low = ordered[_first_beyond(ends, below)]
    high = ordered[_first_beyond(ends, np.minimum(below + 1, total - 1))]
    return low + (position - below) * (high - low)


def _first_beyond(ends: NDArray[np.int64], ranks: NDArray[np.int64]) -> NDArray[np.int64]:
    """(R,) in each row the first column whose count exceeds the rank: one search over all rows end to end."""
    stride = int(ends[:, -1].max()) + 1
    offsets = np.arange(len(ends), dtype=np.int64) * stride
    flat = (ends + offsets[:, None]).ravel()
    return np.searchsorted(flat, ranks + offsets, side="right") - np.arange(len(ends)) * ends.shape[1]


def _estimate(value: float, drawn: NDArray[np.float64]) -> Estimate:
    low, high = np.quantile(drawn, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Estimate(value, float(low), float(high))
