"""How DeepPCD's colour network learns: to paint true points as they are, and as nobody could tell from the truth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

import pcdbench
from pcdbench.geometry.neighbors import nearest
from pcdbench.options import Options
from pcdbench.training.stream import TrainingPair
from pcdbench.training.trainee import Example, Preset, Trainee

from ..heading import RoomFrame, laid_along_axes
from ..patch_trainee import PATCHES
from ..patch_truth import true_rows
from ..patches import Patches
from .color import ColorNetwork
from .completer import DeepPCDOptions
from .inference import painted
from .neighborhoods import Neighborhoods
from .trainee import EPOCH, NEIGHBORHOODS

PAINTED = 512  # points a patch
NOISE = 0.01  # of the patch: completed points do not lie as exactly as true ones
DISCRIMINATOR_RATE = 0.5  # of the generator's, as published: 1e-4 and 2e-4
# Published: 1. Fooling a discriminator then weighs a dozen times as much as being right, and within hours of two cores
# the generator paints everything one grey (measured).
FOOLING_WEIGHT = 0.001


class ColorTrainee(Trainee):
    """Conditional GAN: the L1 distance of colours, and binary cross entropy of both sides.

    It needs no geometry network: what it paints in training are true points, moved a little, whose colour is that of
    the true point they were.
    """

    presets: ClassVar[Mapping[str, Preset]] = {
        "default": Preset(learning_rate=1e-3, batch=2, weight_decay=0.0),
        "published": Preset(learning_rate=2e-4, batch=2, weight_decay=0.0, steps=500 * EPOCH // 2),
    }

    def __init__(self, options: DeepPCDOptions | None = None) -> None:
        """Train on patches of these options' grid; the others play no part."""
        self.options = DeepPCDOptions.model_validate({}) if options is None else options

    @classmethod
    def for_options(cls, options: Options) -> ColorTrainee:
        assert isinstance(options, DeepPCDOptions)
        return cls(options)

    def network(self) -> nn.Module:
        return ColorNetwork()

    def parameter_groups(self, network: nn.Module) -> Iterable[dict[str, Any]]:
        assert isinstance(network, ColorNetwork)
        return [
            {"params": [*network.condition.parameters(), *network.generator.parameters()]},
            {"params": list(network.discriminator.parameters()), "rate": DISCRIMINATOR_RATE},
        ]

    def completes(self, tensor: str) -> bool:
        return not tensor.startswith("discriminator.")

    def completer(self, network: nn.Module) -> pcdbench.Completer:
        """A completer that paints anew what is there and completes nothing: its Chamfer distance is the input's."""
        assert isinstance(network, ColorNetwork)
        return _PaintedAnew(network, self.options.grid)

    def example(self, pair: TrainingPair, rng: np.random.Generator) -> Example:
        """Some observed patches with colours and neighbourhoods, and `truth` (P, 512, 3) points of the same patches
        with `truth_colors` (P, 512, 3).
        """
        pair = laid_along_axes(pair)
        observed = pair.complete.select(pair.kept)
        every = Patches.of(observed.points, self.options.grid, rng)
        assert every is not None  # the fullest of G x G cells holds a mean cell's points at least
        patches = every.select(np.sort(rng.permutation(len(every.number))[:PATCHES]))
        assert pair.truth.colors is not None
        # Some pairs come without colour; the truth knows it.
        seen = pair.truth.colors[nearest(observed.points, pair.truth.points)[1]]
        some = pair.truth.select(rng.permutation(len(pair.truth))[: 4 * PAINTED * len(every.number)])
        scaled = patches.grid.scaled(some.points)
        assert some.colors is not None
        points, colors = [], []
        for at, rows in enumerate(true_rows(patches, scaled)):
            cloud = (patches.points[at], seen[patches.rows[at]])
            if len(rows):
                cloud = ((scaled[rows] - patches.low[at]) / patches.scale, some.colors[rows])
            drawn = rng.integers(len(cloud[0]), size=PAINTED)
            points.append(cloud[0][drawn] + rng.normal(scale=NOISE, size=(PAINTED, 3)))
            colors.append(cloud[1][drawn])
        return {
            "points": patches.points,
            "colors": seen[patches.rows],
            **vars(Neighborhoods.of(patches.points)),
            "truth": np.stack(points).astype(np.float32),
            "truth_colors": np.stack(colors),
        }

    def loss(self, network: nn.Module, example: dict[str, Tensor]) -> dict[str, Tensor]:
        around = tuple(example[name] for name in NEIGHBORHOODS)
        truth = example["truth_colors"]
        colors, real, fake, fooled = network(example["points"], example["colors"], around, example["truth"], truth)
        color = (colors - truth).abs().mean()
        judging = _entropy(real, 1.0) + _entropy(fake, 0.0)
        fooling = _entropy(fooled, 1.0)
        # The sum is one backward pass; no gradient of one side's terms reaches the other side.
        loss = color + FOOLING_WEIGHT * fooling + judging
        return {"loss": loss, "color": color, "fooling": fooling, "judging": judging}


def _entropy(logits: Tensor, label: float) -> Tensor:
    return F.binary_cross_entropy_with_logits(logits, torch.full_like(logits, label))


class _PaintedAnew(pcdbench.Completer):
    """The points as they are, in the network's colours."""

    def __init__(self, network: ColorNetwork, grid: int) -> None:
        super().__init__()
        self._network, self._grid = network, grid

    def complete(self, cloud: pcdbench.PointCloud, rng: np.random.Generator) -> pcdbench.PointCloud:
        if cloud.colors is None:
            return cloud
        patches = Patches.of(RoomFrame.of(cloud.points).laid(cloud).points, self._grid, rng)
        if patches is None:
            return cloud
        scaled = (patches.low[:, None] + patches.scale * patches.points).reshape(-1, 3)
        colors = cloud.colors.copy()
        around = Neighborhoods.of(patches.points)
        every = np.ones(len(scaled), dtype=bool)
        colors[patches.rows.ravel()] = painted(self._network, patches, around, cloud.colors, scaled, every)
        return pcdbench.PointCloud(cloud.points, colors)
