"""deeppcd and deeppcd_merged: the network's own cloud, and what was observed with its gaps filled by that."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

import pcdbench
from pcdbench.geometry.neighbors import nearest
from pcdbench.threads import thread_count

from ..local_surface import surface_spacing
from ..patches import Patches
from ..patchwise import PatchwiseCompleter, PatchwiseOptions

if TYPE_CHECKING:
    from .color import PaintingNetwork
    from .network import DeepPCDNetwork

SHIPPED = Path(__file__).with_name("weights.safetensors")
SHIPPED_COLOR = Path(__file__).with_name("color.safetensors")
OBSERVED_SPACINGS = 1.5  # a completed point this near to an observed one lies on observed surface


class DeepPCDOptions(PatchwiseOptions):
    """Options of deeppcd: those that change the network need weights that were trained with them."""

    plane_points: Literal[256, 512, 1024, 2048] = Field(1024, description="plane points of a patch")
    generator: bool = Field(True, description="turn plane points by the generator; else one fixed grid a patch")
    color: Literal["nearest", "network"] = Field(
        "nearest",
        description="where nothing was observed: the nearest observed colour (merged, those around, continued), or the "
        "colour network's",
    )
    color_weights: str = Field("", description="likewise for the colour network, with color=network")

    @model_validator(mode="after")
    def _weights_are_used(self) -> Self:
        if self.color_weights and self.color != "network":
            raise ValueError("color_weights are of the colour network; add color=network")
        return self


class DeepPCD(PatchwiseCompleter):
    """DeepPCD: patches related by a transformer, plane points moved to the surface; the network's own cloud.

    All points are the network's, observed surface too, as published. A cloud with colour is coloured: where something
    was observed by what was observed there; elsewhere by the nearest observed colour, or by the colour network.
    """

    Options: ClassVar[type[pcdbench.Options]] = DeepPCDOptions
    options: DeepPCDOptions
    version = "5"
    citation = "DeepPCD: Enabling AutoCompletion of Indoor Point Clouds with Deep Learning, IMWUT 2022"
    trainee = "pcdbench_completers.deeppcd.trainee:DeepPCDTrainee"
    color_trainee = "pcdbench_completers.deeppcd.color_trainee:ColorTrainee"

    def __init__(
        self,
        options: DeepPCDOptions | None = None,
        network: DeepPCDNetwork | None = None,
        painting: PaintingNetwork | None = None,
    ) -> None:
        """Load the weights, or use networks that are there already (in training)."""
        super().__init__(options)
        from .color import PaintingNetwork
        from .network import DeepPCDNetwork

        if network is None:
            network = DeepPCDNetwork(self.options.plane_points, self.options.generator)
            network = self.trained(network, SHIPPED, self.options.weights, "deeppcd")
        if painting is None and self.options.color == "network":
            painting = self.trained(PaintingNetwork(), SHIPPED_COLOR, self.options.color_weights, "deeppcd.color")
        self._network, self._painting = network, painting

    def model_card(self) -> Mapping[str, Any] | None:
        """That of the geometry network, and that of the colour network under `color`."""
        if not self._weights:
            return None
        geometry, *color = [weights.card or {} for weights in self._weights]
        if not color:
            return geometry
        seen = [*geometry.get("trained_on", []), *color[0].get("trained_on", [])]
        return {**geometry, "trained_on": seen, "color": color[0]}

    @property
    def paints(self) -> bool:
        return self._painting is not None

    def found(self, cloud: pcdbench.PointCloud, patches: Patches, rng: np.random.Generator) -> pcdbench.PointCloud:
        """The completed cloud, 1,024 points a patch (or `plane_points`)."""
        import torch

        from .inference import completed, painted
        from .neighborhoods import Neighborhoods

        torch.set_num_threads(thread_count())
        around = Neighborhoods.of(patches.points)
        scaled = completed(self._network, patches, around)
        points = patches.grid.metric(scaled)
        if cloud.colors is None:
            return pcdbench.PointCloud(points)
        distances, index = nearest(points, cloud.points)
        colors = cloud.colors[index]
        if self._painting is not None:
            new = distances > OBSERVED_SPACINGS * surface_spacing(cloud.points - cloud.points.mean(axis=0))
            colors[new] = painted(self._painting, patches, around, cloud.colors, scaled, new)
        return pcdbench.PointCloud(points, colors)


class DeepPCDMergedOptions(DeepPCDOptions):
    """Options of deeppcd_merged."""

    keep_observed: bool = Field(True, description=PatchwiseOptions.model_fields["keep_observed"].description)
    passes: int = Field(2, ge=1, description=PatchwiseOptions.model_fields["passes"].description)


class DeepPCDMerged(DeepPCD):
    """What was observed, all of it, and deeppcd's points where nothing was, at the observed density.

    Its planes reach only so far into a hole, so it is asked again, about what the first pass left.
    """

    Options = DeepPCDMergedOptions
    version = "6"
