"""How voxel_unet learns: which sub-voxels hold surface where nothing was observed, where in them, what colour."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from torch import Tensor, nn
from torch.nn import functional as F

from pcdbench.completer import Completer
from pcdbench.options import Options
from pcdbench.training.stream import TrainingPair
from pcdbench.training.trainee import Example, Preset, Trainee

from ..heading import laid_along_axes
from ..local_surface import surface_spacing
from .completer import VOXEL_SPACINGS, VoxelUNetCompleter
from .grid import CHANNELS, Grid, network_input, sub_voxel_means
from .network import WIDTHS, VoxelUNet, placed

WINDOW = (56, 56, 32)  # voxels of an example at most: all of most rooms, of the widest corridor a third
BESIDE_OBSERVED = 0.25  # the weight of sub-voxels next to observed ones: much is known of them already
WEIGHTS = (1.0, 1.0, BESIDE_OBSERVED, BESIDE_OBSERVED, 0.0)  # by `state`


class VoxelUNetTrainee(Trainee):
    """Cross entropy on unobserved sub-voxels, L1 on the offsets and colours of the truly occupied ones."""

    presets: ClassVar = {"default": Preset(learning_rate=2e-3, batch=2)}

    def __init__(
        self,
        widths: tuple[int, ...] = WIDTHS,
        voxel_spacings: float = VOXEL_SPACINGS,
        options: VoxelUNetCompleter.Options | None = None,
    ) -> None:
        """The study of the network's size trains others than the one that is shipped; options count in validation."""
        self._widths, self._voxel_spacings, self._options = widths, voxel_spacings, options

    @classmethod
    def for_options(cls, options: Options) -> VoxelUNetTrainee:
        assert isinstance(options, VoxelUNetCompleter.Options)
        return cls(options=options)

    def network(self) -> nn.Module:
        return VoxelUNet(self._widths)

    def completer(self, network: nn.Module) -> Completer:
        assert isinstance(network, VoxelUNet)
        return VoxelUNetCompleter(self._options, network=network, voxel_spacings=self._voxel_spacings)

    def example(self, pair: TrainingPair, rng: np.random.Generator) -> Example:
        """`features` (13, X, Y, Z) and, by sub-voxel: `state` (2X, 2Y, 2Z) uint8, 0 empty, 1 occupied, plus 2 beside
        observed ones, 4 observed; `at` (M, 3) of the occupied ones with their `offsets` (M, 3) and `colors` (M, 3).
        """
        pair = laid_along_axes(pair)
        observed = pair.complete.select(pair.kept)
        edge = self._voxel_spacings * surface_spacing(observed.points) * rng.uniform(0.9, 1.1)
        whole = Grid.around(observed.points, edge, rng.random(3))
        grid = _window(whole, observed.points[rng.integers(len(observed))], rng)
        seen = observed.select(grid.holds(observed.points))
        truth = pair.truth.select(grid.holds(pair.truth.points))
        fine = tuple(2 * n for n in grid.shape)
        observed_fine = np.zeros(int(np.prod(fine)), dtype=bool)
        observed_fine[grid.cells(seen.points, per_edge=2)[0]] = True
        observed_fine = observed_fine.reshape(fine)
        index, offsets, colors = sub_voxel_means(truth, grid)
        state = np.zeros(fine, dtype=np.uint8)
        state.reshape(-1)[index] = 1
        state[binary_dilation(observed_fine)] += 2
        state[observed_fine] = 4
        if seen.colors is None or colors is None:
            colors = np.zeros((0, 3), np.float32)
        return {
            "features": network_input(seen, grid),
            "state": state,
            "at": np.stack(np.unravel_index(index, fine), axis=1),
            "offsets": offsets,
            "colors": colors,
        }

    def collate(self, examples: Sequence[Example]) -> list[Example]:
        """All of them as one: a batch, its grids padded to the largest with space that does not count."""
        shape = np.max([example["state"].shape for example in examples], axis=0)
        features = np.zeros((len(examples), CHANNELS, *(shape // 2)), dtype=np.float32)
        state = np.full((len(examples), *shape), 4, dtype=np.uint8)
        for item, example in enumerate(examples):
            x, y, z = example["state"].shape
            features[item, :, : x // 2, : y // 2, : z // 2] = example["features"]
            state[item, :x, :y, :z] = example["state"]
        at = [np.insert(example["at"], 0, item, axis=1) for item, example in enumerate(examples)]
        colored = [np.full(len(example["at"]), len(example["colors"]) > 0) for example in examples]
        together = {name: np.concatenate([example[name] for example in examples]) for name in ("offsets", "colors")}
        return [
            {"features": features, "state": state, "at": np.concatenate(at), "colored": np.concatenate(colored)}
            | together
        ]

    def loss(self, network: nn.Module, example: dict[str, Tensor]) -> dict[str, Tensor]:
        out = network(example["features"])
        state = example["state"]
        weight = torch.tensor(WEIGHTS, device=state.device)[state.int()]
        occupied = (state % 2).float()
        entropy = F.binary_cross_entropy_with_logits(out[:, 0].float(), occupied, weight, reduction="sum")
        entropy = entropy / (state < 4).sum().clamp(min=1)
        item, x, y, z = example["at"].T
        offsets, colors = placed(out[item, 1:, x, y, z])
        colored = example["colored"]
        offset = (offsets - example["offsets"]).abs().mean() if len(offsets) else out.sum() * 0
        color = (colors[colored] - example["colors"]).abs().mean() if colored.any() else out.sum() * 0
        return {"loss": 10 * entropy + offset + color, "entropy": entropy, "offset": offset, "color": color}


def _window(grid: Grid, center: NDArray[np.float64], rng: np.random.Generator) -> Grid:
    """A part of the grid no larger than WINDOW, around a point of it."""
    size = np.minimum(grid.shape, WINDOW)
    at = np.floor((center - grid.origin) / grid.edge_m - size * rng.uniform(0.2, 0.8, size=3))
    start = np.clip(at, 0, np.array(grid.shape) - size)
    return grid.part(start, start + size)
