"""How FoldingNet learns: the folded grid of each patch by the Chamfer distance of its publication."""

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
from .completer import FoldingNet
from .neighbors import nearest_16
from .network import FOLDED, FoldingNetNetwork


class FoldingNetTrainee(PatchTrainee):
    """The larger of the mean distances, not squared, to the truth and from it (equation 1)."""

    presets: ClassVar[Mapping[str, Preset]] = {
        "default": Preset(learning_rate=3e-4, batch=2),
        "published": Preset(learning_rate=1e-4, batch=1, weight_decay=1e-6, steps=1_600_000),
    }

    def network(self) -> nn.Module:
        return FoldingNetNetwork()

    def completer(self, network: nn.Module) -> FoldingNet:
        assert isinstance(network, FoldingNetNetwork)
        return FoldingNet(self.options, network=network)

    def example(self, pair: TrainingPair, rng: np.random.Generator) -> Example:
        """Eight patches with their `neighbors` (8, 1024, 16), and the points to fold: `chosen` (8, 1024)."""
        example = self.patches(pair, rng)
        points = example["points"]
        return example | {"neighbors": nearest_16(points), "chosen": drawn(len(points), FOLDED, rng)}

    def loss(self, network: nn.Module, example: dict[str, Tensor]) -> dict[str, Tensor]:
        folded = network(example["points"], example["neighbors"], example["chosen"])
        to_truth, from_truth = distances_by_patch(folded, example["truth"], example["truth_of"], power=1)
        loss = torch.maximum(to_truth, from_truth).mean()
        return {"loss": loss, "to_truth": to_truth.mean(), "from_truth": from_truth.mean()}
