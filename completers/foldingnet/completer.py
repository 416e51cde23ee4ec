"""foldingnet: FoldingNet's own cloud, patch by patch."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..patches import Patches
from ..patchwise import LonePatchCompleter, PatchwiseOptions

if TYPE_CHECKING:
    from .network import FoldingNetNetwork

SHIPPED = Path(__file__).with_name("weights.safetensors")


class FoldingNet(LonePatchCompleter):
    """FoldingNet with the hyper-parameters of its publication, on each patch alone: it was made for small objects.

    All 2,025 points of a patch's grid make up the completed cloud.
    """

    version = "3"
    citation = "Yang et al., FoldingNet: Point Cloud Auto-encoder via Deep Grid Deformation, CVPR 2018"
    trainee = "pcdbench_completers.foldingnet.trainee:FoldingNetTrainee"

    def __init__(self, options: PatchwiseOptions | None = None, network: FoldingNetNetwork | None = None) -> None:
        """Load the weights, or use a network that is there already (in training)."""
        super().__init__(options)
        from .network import FoldingNetNetwork

        self._network = network or self.trained(FoldingNetNetwork(), SHIPPED, self.options.weights, "foldingnet")

    def completed(self, patches: Patches, rng: np.random.Generator) -> NDArray[np.float32]:
        import torch

        from .neighbors import nearest_16

        folded = self._network(torch.from_numpy(patches.points), torch.from_numpy(nearest_16(patches.points)))
        return folded.numpy()
