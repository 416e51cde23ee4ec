"""How PCN learns: coarse and fine points of each patch by the Chamfer distance of its publication."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from pcdbench.training.stream import TrainingPair
from pcdbench.training.trainee import Example, Preset

from ..patch_trainee import PatchTrainee, drawn
from ..patch_truth import distances_by_patch
from .completer import PCN
from .network import FINE, PCNNetwork

FINE_WEIGHT = 1.0  # what the published alpha reaches; it begins at 0.01, of 300,000 steps


class PCNTrainee(PatchTrainee):
    """Mean distances both ways, not squared, of the coarse points + those of the fine ones (section 3.4)."""

    presets: ClassVar[Mapping[str, Preset]] = {
        "default": Preset(learning_rate=3e-4, batch=2),
        "published": Preset(learning_rate=1e-4, batch=4, weight_decay=0.0, steps=300_000),
    }

    def network(self) -> nn.Module:
        return PCNNetwork()

    def completer(self, network: nn.Module) -> PCN:
        assert isinstance(network, PCNNetwork)
        return PCN(self.options, network=network)

    def example(self, pair: TrainingPair, rng: np.random.Generator) -> Example:
        """Eight patches and the fine points to fold: `chosen` (8, 1024)."""
        example = self.patches(pair, rng)
        return example | {"chosen": drawn(len(example["points"]), FINE, rng)}

    def loss(self, network: nn.Module, example: dict[str, Tensor]) -> dict[str, Tensor]:
        coarse, fine = (
            torch.stack(distances_by_patch(points, example["truth"], example["truth_of"], power=1)).sum(dim=0).mean()
            for points in network(example["points"], example["chosen"])
        )
        return {"loss": coarse + FINE_WEIGHT * fine, "coarse": coarse, "fine": fine}
