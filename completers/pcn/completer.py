"""pcn: PCN's own cloud, patch by patch."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..patches import Patches
from ..patchwise import LonePatchCompleter, PatchwiseOptions

if TYPE_CHECKING:
    from .network import PCNNetwork

SHIPPED = Path(__file__).with_name("weights.safetensors")
POINTS = 1024  # of the 16,384 fine points of a patch: all of them would be cut to about as many before any metric


class PCN(LonePatchCompleter):
    """PCN with the hyper-parameters of its publication, on each patch alone: it was made for small objects.

    A random 1,024 of a patch's 16,384 points make up the completed cloud.
    """

    version = "3"
    citation = "Yuan et al., PCN: Point Completion Network, 3DV 2018"
    trainee = "pcdbench_completers.pcn.trainee:PCNTrainee"

    def __init__(self, options: PatchwiseOptions | None = None, network: PCNNetwork | None = None) -> None:
        """Load the weights, or use a network that is there already (in training)."""
        super().__init__(options)
        from .network import PCNNetwork

        self._network = network or self.trained(PCNNetwork(), SHIPPED, self.options.weights, "pcn")

    def completed(self, patches: Patches, rng: np.random.Generator) -> NDArray[np.float32]:
        import torch

        from .network import FINE

        chosen = np.stack([rng.choice(FINE, POINTS, replace=False) for _ in patches.number])
        _, fine = self._network(torch.from_numpy(patches.points), torch.from_numpy(chosen))
        return fine.numpy()
