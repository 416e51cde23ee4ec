"""The colour network: a conditional GAN that paints the points of a patch by what was observed of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..layers import SharedMLP, SplitLinear, begin
from .encoder import Neighbors, PatchEncoder

CONDITION = 512
POOLED = 256
POINTWISE = (32, 64, 128, POOLED)


class Painted(NamedTuple):
    """What training looks at; logits are a patch's.

    Attributes:
        colors: (P, M, 3) of the generator, in [0, 1].
        real: (P,) the discriminator's logits of true colours.
        fake: (P,) those of the generator's colours: for the discriminator to learn from.
        fooled: (P,) the same logits: for the generator to learn from.
    """

    colors: Tensor
    real: Tensor
    fake: Tensor
    fooled: Tensor


class ColorNetwork(nn.Module):
    """DeepPCD's colour network, Tables 5 to 7 of the publication read literally: 2,608,196 parameters."""

    def __init__(self) -> None:
        super().__init__()
        self.condition = PatchEncoder(6, (CONDITION,))
        self.generator = Generator()
        self.discriminator = Discriminator()
        begin(self)

    def forward(
        self, observed: Tensor, observed_colors: Tensor, around: Neighbors, points: Tensor, colors: Tensor
    ) -> Painted:
        """Paint points whose colours are known, and judge both paintings.

        Gradients of `fake` and `real` reach the discriminator alone, those of `colors` and `fooled` the generator
        and the condition alone, so that one backward pass and one optimizer serve both sides.

        Args:
            observed: (P, N, 3) float32, each patch scaled to [0, 1], and `observed_colors`, (P, N, 3) in [0, 1].
            around: their `Neighborhoods`.
            points: (P, M, 3) to paint, and `colors`, (P, M, 3), what they truly are.
        """
        condition = self.condition(observed, centered(observed_colors), around)[2]
        painted = self.generator(points, condition)
        given = condition.detach()
        judge = dict(self.discriminator.named_parameters())
        frozen = {name: value.detach() for name, value in judge.items()}
        fooled = torch.func.functional_call(self.discriminator, frozen, (points, painted, given))
        return Painted(
            painted,
            self.discriminator(points, colors, given),
            self.discriminator(points, painted.detach(), given),
            fooled,
        )


class PaintingNetwork(nn.Module):
    """The half of the colour network that paints: the condition and the generator, with the weights of the whole."""

    def __init__(self) -> None:
        super().__init__()
        self.condition = PatchEncoder(6, (CONDITION,))
        self.generator = Generator()

    def load_state_dict(self, state_dict: Mapping[str, Any], *args: Any, **kwargs: Any) -> Any:
        """Those of a `ColorNetwork` serve, too: its discriminator is left out."""
        kept = {name: value for name, value in state_dict.items() if not name.startswith("discriminator.")}
        return super().load_state_dict(kept, *args, **kwargs)


def centered(colors: Tensor) -> Tensor:
    """Colours in [-1, 1], as the networks take them, of colours in [0, 1]."""
    return 2 * colors - 1


class Generator(nn.Module):
    """Colours of points, of their features at four depths, of the patch they make up and of the condition."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.ModuleList(
            SharedMLP(before, after) for before, after in zip((3, *POINTWISE[:-1]), POINTWISE, strict=True)
        )
        self.first = SplitLinear(sum(POINTWISE), POOLED + CONDITION, 512)
        self.rest = nn.Sequential(SharedMLP(512, 256, 256, 128), nn.Linear(128, 3))

    def forward(self, points: Tensor, condition: Tensor) -> Tensor:
        """(P, M, 3) float32 colours in [0, 1] of (P, M, 3) points under (P, 512) conditions."""
        features, shared = self.features(points, condition)
        return self.colors(features, shared)

    def features(self, points: Tensor, condition: Tensor) -> tuple[Tensor, Tensor]:
        """(P, M, 480) of each point and (P, 768) of each patch: all that `colors` needs."""
        depths = [points]
        for layer in self.layers:
            depths.append(layer(depths[-1]))
        features = torch.cat(depths[1:], dim=2)
        return features, torch.cat([depths[-1].amax(dim=1), condition.to(features.dtype)], dim=1)

    def colors(self, features: Tensor, shared: Tensor) -> Tensor:
        """(P, K, 3) colours of (P, K, 480), some of a patch's points or all."""
        return torch.sigmoid(self.rest(F.relu_(self.first(features, shared))).float())


class Discriminator(nn.Module):
    """Whether a patch was painted by the generator."""

    def __init__(self) -> None:
        super().__init__()
        self.points = SharedMLP(6, 64, 128, 256, 512, 768)
        self.verdict = nn.Sequential(SharedMLP(768 + CONDITION, 512, 256), nn.Linear(256, 1))

    def forward(self, points: Tensor, colors: Tensor, condition: Tensor) -> Tensor:
        """(P,) float32 logits, above 0 for true colours, of (P, M, 3) points, their colours and (P, 512) conditions."""
        features = self.points(torch.cat([points, centered(colors)], dim=2))
        return self.verdict(torch.cat([features.amax(dim=1), condition.to(features.dtype)], dim=1)).float()[:, 0]
