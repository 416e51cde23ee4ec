"""The networks asked about one cloud, without gradients and in the precision that pays."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pcdbench.training.precision import bfloat16_pays

from ..patches import Patches
from .color import ColorNetwork, PaintingNetwork, centered
from .encoder import Neighbors
from .neighborhoods import Neighborhoods
from .network import DeepPCDNetwork


def as_tensors(around: Neighborhoods) -> Neighbors:
    """The neighbourhoods as the networks take them."""
    fields = (around.sampled_1, around.neighbors_1, around.sampled_2, around.neighbors_2)
    first, second, third, fourth = map(torch.from_numpy, fields)
    return first, second, third, fourth


def completed(network: DeepPCDNetwork, patches: Patches, around: Neighborhoods) -> NDArray[np.float32]:
    """(P * K, 3) the completed points, in the unit of the grid."""
    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=bfloat16_pays()):
        result = network(
            torch.from_numpy(patches.points),
            as_tensors(around),
            torch.from_numpy(patches.cells),
            torch.from_numpy(patches.low),
            torch.tensor(patches.scale),
        )
    return result.points.numpy()


def painted(
    network: ColorNetwork | PaintingNetwork,
    patches: Patches,
    around: Neighborhoods,
    colors: NDArray[np.float32],
    scaled: NDArray[np.float32],
    wanted: NDArray[np.bool_],
) -> NDArray[np.float32]:
    """(W, 3) colours of the wanted ones of the completed points.

    Args:
        colors: (N, 3) of the observed cloud.
        scaled: (P * K, 3) completed points, in the unit of the grid.
        wanted: (P * K,) mask.
    """
    low = patches.low[:, None]
    points = torch.from_numpy((scaled.reshape(len(low), -1, 3) - low) / patches.scale)
    observed, seen = torch.from_numpy(patches.points), torch.from_numpy(colors[patches.rows])
    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=bfloat16_pays()):
        condition = network.condition(observed, centered(seen), as_tensors(around))[2]
        features, shared = network.generator.features(points, condition)
        rows = torch.from_numpy(wanted.reshape(len(low), -1))
        new: list[Tensor] = [
            network.generator.colors(one[which][None], of[None])[0]
            for one, of, which in zip(features, shared, rows, strict=True)
        ]
    return torch.cat(new).numpy()
