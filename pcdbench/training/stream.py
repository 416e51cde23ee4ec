"""The endless stream of training pairs: pair i is decided by the seed and i alone, so that resuming is exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.incompletenesses.holes import Holes
from pcdbench.keys import seed_from
from pcdbench.scene import Scene
from pcdbench.training import augment
from pcdbench.training.truths import WALK_LEVELS, Truth, Truths

ENVIRONMENTS_OF_A_SEED = 50_000  # two million pairs: more than the longest preset takes
SEEDS_APART = 20  # seeds that differ by a multiple of it see the same rooms, in another order

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class TrainingPair:
    """A truth and what is left of a scan of it.

    Attributes:
        truth: the dense cloud, with its natural gaps: what a perfect completer would restore.
        complete: a scan of the truth at the input's density, with noise.
        kept: (N,) mask over `complete` of what is left: the network's input.
    """

    truth: PointCloud
    complete: PointCloud
    kept: Mask


class PairStream:
    """Pairs from freshly generated crops, augmented; `stream[i]` is the same whenever it is asked for.

    A new crop enters the window every `reuse` pairs; a pair draws its crop from the window's latest, so
    that making crops keeps pace with training on two cores and yet no crop is ever the last one. Twenty
    seeds in a row have crops of their own: a training that goes on from weights with another seed sees other rooms.

    Args:
        recipe: which augmentations there are; studies leave some out.
    """

    def __init__(self, seed: int = 0, recipe: augment.Recipe = augment.FULL, window: int = 64, reuse: int = 40) -> None:
        self.seed, self.recipe, self.window, self.reuse = seed, recipe, window, reuse
        self._truths = Truths(window)

    def __getitem__(self, index: int) -> TrainingPair:
        rng = np.random.default_rng(seed_from("training pair", self.seed, index))
        newest = ENVIRONMENTS_OF_A_SEED * (self.seed % SEEDS_APART) + self.window + index // self.reuse
        return training_pair(self._truths[int(rng.integers(newest - self.window, newest))], rng, self.recipe)


def training_pair(truth: Truth, rng: np.random.Generator, recipe: augment.Recipe = augment.FULL) -> TrainingPair:
    """One pair: augment the truth, scan it at some density with noise, take holes or the end of a walk from that."""
    truth = augment.augmented(truth, rng, recipe)
    spacing_m = float(np.exp(rng.uniform(np.log(0.05), np.log(0.13)))) if recipe.density else 0.08
    rows = augment.thinned(truth.cloud.points, spacing_m, rng)
    complete = truth.cloud.select(rows)
    if recipe.noise:
        complete = augment.noisy(complete, rng)
    kept = _walked(truth.missed[rows], rng) if rng.random() < 0.25 else None
    if kept is None:
        kept = _with_holes(complete, rng)
    if rng.random() < 0.15:
        complete = complete.without_colors()
    return TrainingPair(truth.cloud, complete, kept)


def _with_holes(complete: PointCloud, rng: np.random.Generator) -> Mask:
    level = rng.uniform(0.05, 0.6)
    holes = Holes(Holes.Options(share_per_seed=float(np.exp(rng.uniform(np.log(0.008), np.log(0.06))))))
    return holes.kept(Scene("pair", complete, complete, np.arange(0)), level, rng)


def _walked(missed: NDArray[np.uint8], rng: np.random.Generator) -> Mask | None:
    """What a walk sees before it ends; None where that is all or next to nothing."""
    kept = missed < len(WALK_LEVELS) - rng.integers(0, len(WALK_LEVELS))
    return kept if 0.3 < kept.mean() < 0.98 else None
