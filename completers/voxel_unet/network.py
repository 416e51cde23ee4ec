"""The network: a dense 3D U-Net whose last layer splits every voxel into 2 x 2 x 2 sub-voxels."""

from __future__ import annotations

import copy
from itertools import product
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F
from torch.nn.utils.fusion import fuse_conv_bn_eval

from pcdbench.training.precision import bfloat16_pays

from .grid import CHANNELS

WIDTHS = (16, 32, 96, 192, 256)
OUTPUTS = 7  # occupancy logit, offset (3), colour (3)


class ConvBlock(nn.Sequential):
    """Two 3 x 3 x 3 convolutions, each with BatchNorm and SiLU.

    Not GroupNorm, whose statistics depend on how much empty space is around: tiles would differ from the whole.
    """

    def __init__(self, channels_in: int, channels: int) -> None:
        super().__init__(
            nn.Conv3d(channels_in, channels, 3, padding=1, bias=False),
            nn.BatchNorm3d(channels, momentum=0.02),
            nn.SiLU(),
            nn.Conv3d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm3d(channels, momentum=0.02),
            nn.SiLU(),
        )


class UpBlock(ConvBlock):
    """A block over a level and the coarser one below, each of whose voxels stands for 2 x 2 x 2."""

    def __init__(self, below: int, channels: int) -> None:
        super().__init__(below + channels, channels)
        self.below = below

    def forward(self, below: Tensor, skip: Tensor) -> Tensor:  # type: ignore[override]
        """(B, `below`, X / 2, Y / 2, Z / 2), sizes rounded up, and (B, `channels`, X, Y, Z) to the latter's shape."""
        return super().forward(torch.cat([copies(below, skip), skip], dim=1))


def copies(below: Tensor, like: Tensor) -> Tensor:
    """Each voxel as 2 x 2 x 2 copies, cut to the size of the level above, `like`."""
    x, y, z = like.shape[2:]
    return F.interpolate(below, scale_factor=2, mode="nearest")[..., :x, :y, :z]


class VoxelUNet(nn.Module):
    """Occupancy, offset and colour of every sub-voxel from what was observed in the voxels around it."""

    def __init__(self, widths: tuple[int, ...] = WIDTHS) -> None:
        super().__init__()
        self.down = nn.ModuleList(
            ConvBlock(before, after) for before, after in zip((CHANNELS, *widths[:-1]), widths, strict=True)
        )
        self.pool = nn.MaxPool3d(2, ceil_mode=True)
        self.up = nn.ModuleList(UpBlock(below, at) for below, at in zip(widths[1:], widths[:-1], strict=True))
        self.head = nn.Conv3d(widths[0], 8 * OUTPUTS, 1)
        # Almost all sub-voxels are empty: starting from there saves the first hundreds of steps.
        with torch.no_grad():
            self.head.get_parameter("bias")[:8] = -4.0
        # Convolutions are up to twice as fast with channels last. (Torch's own types do not know this argument.)
        self.to(memory_format=torch.channels_last_3d)  # type: ignore[call-overload]

    def _load_from_state_dict(self, state_dict: dict[str, Tensor], prefix: str, *args: Any) -> None:
        """Weights of before channels were added, to the input or to a level, are taken as if those said nothing."""
        for name, own in self.state_dict().items():
            saved = state_dict.get(prefix + name)
            if saved is None or saved.ndim != own.ndim or saved.shape == own.shape:
                continue
            if all(few <= many for few, many in zip(saved.shape, own.shape, strict=True)):
                state_dict[prefix + name] = _widened(saved, own, self._read_from_below(name))
        super()._load_from_state_dict(state_dict, prefix, *args)

    def _read_from_below(self, name: str) -> int | None:
        """How many of the channels that this parameter reads come from the level below; None where there is none."""
        part, level, *rest = name.split(".")
        block = self.up[int(level)] if part == "up" and rest == ["0", "weight"] else None
        return block.below if isinstance(block, UpBlock) else None

    def forward(self, features: Tensor) -> Tensor:
        """(B, 13, X, Y, Z) to (B, 7, 2X, 2Y, 2Z): logit of occupancy, and what `placed` takes."""
        return split_voxels(self.head(self.trunk(features)))

    def trunk(self, features: Tensor) -> Tensor:
        """All but the last layer: (B, 13, X, Y, Z) to (B, 16, X, Y, Z)."""
        skips = []
        x = features.to(self.head.weight.dtype, memory_format=torch.channels_last_3d)
        for level, block in enumerate(self.down):
            x = block(x if level == 0 else self.pool(x))
            skips.append(x)
        for level in reversed(range(len(self.up))):
            x = self.up[level](x, skips[level])
        return x

    def occupancy(self, trunk: Tensor) -> Tensor:
        """(2X, 2Y, 2Z) float32 logits of one item's trunk (1, 16, X, Y, Z): the first of what `forward` gives."""
        voxels = F.linear(trunk[0].movedim(0, 3), *self._head_of(slice(0, 8))).float()
        return split_voxels(voxels.movedim(3, 0)[None])[0, 0]

    def details(self, trunk: Tensor, at: Tensor) -> tuple[Tensor, Tensor]:
        """What `placed` gives at (M, 3) sub-voxels of one item's trunk: most of them hold nothing to place."""
        x, y, z = (at // 2).T
        out = F.linear(trunk[0].movedim(0, 3)[x, y, z], *self._head_of(slice(8, None)))
        corner = at % 2 @ torch.tensor([4, 2, 1])
        return placed(out.unflatten(1, (OUTPUTS - 1, 8))[torch.arange(len(at)), :, corner])

    def _head_of(self, channels: slice) -> tuple[Tensor, Tensor]:
        """The last layer's weights (K, 16) and biases (K,) of some of its channels, eight an output."""
        return self.head.weight.flatten(1)[channels], self.head.get_parameter("bias")[channels]


def _widened(saved: Tensor, own: Tensor, below: int | None) -> Tensor:
    """A parameter of narrower levels in the shape of `own`, which it keeps where it is of new channels alone.

    New channels say nothing to the others, which so answer as before, and learn to from there.

    Args:
        below: see `_read_from_below`.
    """
    wide, count = own.clone(), len(saved)
    if saved.ndim == 1:
        wide[:count] = saved
        return wide
    read = torch.arange(saved.shape[1])
    if below is not None:  # the last of them are the skip's, as many as are written
        read[-count:] += below - (len(read) - count)
    wide[:count] = 0
    wide[:count, read] = saved
    return wide


def placed(values: Tensor) -> tuple[Tensor, Tensor]:
    """(M, 6) of the network's last channels at some sub-voxels: offsets (M, 3) in sub-voxels, colours (M, 3)."""
    values = values.float()
    return torch.tanh(values[:, :3]) / 2, torch.sigmoid(values[:, 3:])


class OneDnnConv(nn.Conv3d):
    """A convolution that runs in oneDNN whatever its size; torch leaves small single inputs to a far slower kernel."""

    def forward(self, x: Tensor) -> Tensor:
        assert not isinstance(self.padding, str)
        strides = self.stride, self.dilation, self.groups
        return torch.mkldnn_convolution(x, self.weight, self.bias, self.padding, *strides)


class FastUpBlock(nn.Module):
    """What an `UpBlock` without BatchNorm gives, to rounding; the copies of coarse voxels are never made.

    A 3 x 3 x 3 convolution over copies reads each of eight coarse voxels up to eight times. It is a transposed
    convolution of the coarse ones, whose weights are sums of its own: 8 products a voxel for 27.
    """

    def __init__(self, block: UpBlock) -> None:
        super().__init__()
        weight, bias = block[0].get_parameter("weight").detach(), block[0].get_parameter("bias").detach()
        of_below, of_skip = weight[:, : block.below], weight[:, block.below :]
        # Copy a (0 or 1) of a coarse voxel, read by tap i, adds to place a - i + 2 of the four that the voxel reaches.
        reach = torch.zeros(4, 3)
        for a, i in product((0, 1), range(3)):
            reach[a - i + 2, i] = 1
        with torch.device("meta"):  # no weights of their own, which would be drawn from torch's generator
            self.of_below = nn.ConvTranspose3d(block.below, len(weight), 4, stride=2, padding=1, bias=False)
            self.of_copies = nn.Conv3d(block.below, len(weight), 3, padding=1, bias=False)
            self.of_skip = nn.Conv3d(of_skip.shape[1], len(weight), 3, padding=1)
        self.of_below.weight = nn.Parameter(torch.einsum("ocxyz,ix,jy,kz->coijk", of_below, reach, reach, reach))
        self.of_copies.weight = nn.Parameter(of_below)
        self.of_skip.weight, self.of_skip.bias = nn.Parameter(of_skip), nn.Parameter(bias)
        self.rest = nn.Sequential(*list(block)[1:])

    def forward(self, below: Tensor, skip: Tensor) -> Tensor:
        """As that of `UpBlock`."""
        x, y, z = skip.shape[2:]
        added = self.of_below(below)[..., :x, :y, :z]
        for axis in (2, 3, 4):
            fine, coarse = skip.shape[axis], below.shape[axis]
            if fine < 2 * coarse:
                # The second copy of the last coarse voxel is cut off, and must not be read by the last fine one.
                few, ends = min(2, coarse), min(3, fine)
                copied = copies(below.narrow(axis, coarse - few, few), skip.narrow(axis, fine - ends, ends))
                added.select(axis, -1).copy_(self.of_copies(copied).select(axis, -1))
        return self.rest(self.of_skip(skip).add_(added))


def for_inference(network: VoxelUNet) -> VoxelUNet:
    """A copy with the same outputs (to rounding) that answers in a fraction of the time on a CPU, not to be trained."""
    network = copy.deepcopy(network).eval()
    for block in (*network.down, *network.up):
        for at in (0, 3):
            block[at] = fuse_conv_bn_eval(block[at], block[at + 1])
            block[at + 1], block[at + 2] = nn.Identity(), nn.SiLU(inplace=True)
    network.up = nn.ModuleList(FastUpBlock(block) for block in network.up if isinstance(block, UpBlock))
    network.to(memory_format=torch.channels_last_3d)  # type: ignore[call-overload]
    if torch.backends.mkldnn.is_available():
        for module in network.modules():
            if type(module) is nn.Conv3d:
                module.__class__ = OneDnnConv
    return network.bfloat16() if bfloat16_pays() else network


def split_voxels(x: Tensor) -> Tensor:
    """(B, 8 C, X, Y, Z) to (B, C, 2X, 2Y, 2Z): the 3D pixel shuffle."""
    batch, channels, *shape = x.shape
    x = x.view(batch, channels // 8, 2, 2, 2, *shape).permute(0, 1, 5, 2, 6, 3, 7, 4)
    return x.reshape(batch, channels // 8, *(2 * n for n in shape))
