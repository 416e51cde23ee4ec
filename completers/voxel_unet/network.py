"""The network: a dense 3D U-Net whose last layer splits every voxel into 2 x 2 x 2 sub-voxels."""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from .grid import CHANNELS

WIDTHS = (16, 32, 64, 96, 128)
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


class VoxelUNet(nn.Module):
    """Occupancy, offset and colour of every sub-voxel from what was observed in the voxels around it."""

    def __init__(self, widths: tuple[int, ...] = WIDTHS) -> None:
        super().__init__()
        self.down = nn.ModuleList(
            ConvBlock(before, after) for before, after in zip((CHANNELS, *widths[:-1]), widths, strict=True)
        )
        self.pool = nn.MaxPool3d(2, ceil_mode=True)
        self.up = nn.ModuleList(ConvBlock(below + at, at) for below, at in zip(widths[1:], widths[:-1], strict=True))
        self.grow = nn.Upsample(scale_factor=2, mode="nearest")
        self.head = nn.Conv3d(widths[0], 8 * OUTPUTS, 1)
        # Almost all sub-voxels are empty: starting from there saves the first hundreds of steps.
        with torch.no_grad():
            self.head.get_parameter("bias")[:8] = -4.0

    def forward(self, features: Tensor) -> Tensor:
        """(B, 10, X, Y, Z) to (B, 7, 2X, 2Y, 2Z): logit, offset in sub-voxels (tanh / 2), colour (sigmoid)."""
        skips = []
        x = features
        for level, block in enumerate(self.down):
            x = block(x if level == 0 else self.pool(x))
            skips.append(x)
        for level in reversed(range(len(self.up))):
            skip = skips[level]
            x = self.grow(x)[..., : skip.shape[2], : skip.shape[3], : skip.shape[4]]
            x = self.up[level](torch.cat([x, skip], dim=1))
        x = split_voxels(self.head(x))
        return torch.cat([x[:, :1], torch.tanh(x[:, 1:4]) / 2, torch.sigmoid(x[:, 4:])], dim=1)


class OneDnnConv(nn.Conv3d):
    """A convolution that runs in oneDNN whatever its size; torch leaves small single inputs to a far slower kernel."""

    def forward(self, x: Tensor) -> Tensor:
        assert not isinstance(self.padding, str)
        strides = self.stride, self.dilation, self.groups
        return torch.mkldnn_convolution(x, self.weight, self.bias, self.padding, *strides)


def for_inference(network: VoxelUNet) -> VoxelUNet:
    """A copy with the same outputs (to rounding) that answers in half the time on a CPU, and is not to be trained."""
    network = copy.deepcopy(network).eval()
    for block in (*network.down, *network.up):
        for at in (0, 3):
            block[at] = fuse_conv_bn_eval(block[at], block[at + 1])
            block[at + 1], block[at + 2] = nn.Identity(), nn.SiLU(inplace=True)
    if torch.backends.mkldnn.is_available():
        for module in network.modules():
            if type(module) is nn.Conv3d:
                module.__class__ = OneDnnConv
    return network


def split_voxels(x: Tensor) -> Tensor:
    """(B, 8 C, X, Y, Z) to (B, C, 2X, 2Y, 2Z): the 3D pixel shuffle."""
    batch, channels, *shape = x.shape
    x = x.view(batch, channels // 8, 2, 2, 2, *shape).permute(0, 1, 5, 2, 6, 3, 7, 4)
    return x.reshape(batch, channels // 8, *(2 * n for n in shape))
