"""What PCN and FoldingNet learn from: some patches of each cloud, each with its own truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcdbench.options import Options
from pcdbench.training.stream import TrainingPair
from pcdbench.training.trainee import Example, Trainee

from .heading import laid_along_axes
from .patch_truth import TRUTH_POINTS, evenly, true_patches
from .patches import Patches
from .patchwise import PatchwiseOptions

PATCHES = 8  # of a cloud, drawn anew each time: they know nothing of each other, and many clouds teach more
FOUND = 1024  # points a patch, drawn anew each time, that the loss looks at


class PatchTrainee(Trainee):
    """Examples for networks that complete each patch on its own."""

    def __init__(self, options: PatchwiseOptions | None = None) -> None:
        """Train on patches of these options' grid; the others count in validation, but for weights."""
        self.options = PatchwiseOptions.model_validate({}) if options is None else options

    @classmethod
    def for_options(cls, options: Options) -> PatchTrainee:
        assert isinstance(options, PatchwiseOptions)
        return cls(options)

    def patches(self, pair: TrainingPair, rng: np.random.Generator) -> Example:
        """`points` (P, 1024, 3) of some patches, and their truth: `truth` (U, 3) of the patches `truth_of` (U,)."""
        pair = laid_along_axes(pair)
        every = Patches.of(pair.complete.select(pair.kept).points, self.options.grid, rng)
        assert every is not None  # the fullest of G x G cells holds a mean cell's points at least
        some = every.select(np.sort(rng.permutation(len(every.number))[:PATCHES]))
        truth = pair.truth.points[evenly(pair.truth.points, TRUTH_POINTS, rng)]
        truth_of, points = true_patches(some, some.grid.scaled(truth))
        return {"points": some.points, "truth": points, "truth_of": truth_of}


def drawn(patches: int, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """(patches, 1024) which of `count` points of each patch the loss looks at."""
    return rng.random((patches, count)).argsort(axis=1)[:, :FOUND]
