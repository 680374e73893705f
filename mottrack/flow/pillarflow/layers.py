"""Building blocks of the networks: convolutions, pyramid, warping, estimator, context (III-B)."""

from __future__ import annotations

from typing import TypeVar

import torch
from torch import nn
from torch.nn import functional

from mottrack.flow.pillarflow.config import NetworkConfig

Module = TypeVar("Module", bound=nn.Module)

LEAK = 0.1
"""Negative slope of every LeakyReLU, as in PWC-Net; the context network's is a setting."""


def conv_block(
    inputs: int, outputs: int, *, stride: int = 1, dilation: int = 1, kernel: int = 3
) -> nn.Sequential:
    """Return a convolution without bias, batch normalisation and LeakyReLU.

    The output has the size of the input divided by `stride`.
    """
    padding = dilation * (kernel // 2)
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, padding, dilation, bias=False),
        nn.BatchNorm2d(outputs),
        nn.LeakyReLU(LEAK, inplace=True),
    )


def small_init(layer: nn.Conv2d) -> nn.Conv2d:
    """Initialise an output layer near zero, so that training starts from zero flow."""
    # small beside the displacements (decimetres to metres), but not zero: a zero layer would pass
    # no gradient to the layers before it in the first step
    nn.init.normal_(layer.weight, std=1e-3)
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)
    return layer


def channels_last(module: Module) -> Module:
    """Return the module in the memory order that CPU and tensor-core convolutions prefer."""
    moved: Module = module.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    return moved


def concatenate(maps: list[torch.Tensor]) -> torch.Tensor:
    """Concatenate maps (B,.,H,W) along the channels in the precision of the next convolution.

    Under autocast `torch.cat` would widen all of them to float32 first and the convolution narrow
    the result again: the same numbers, at a quarter of the whole network's time on a CPU.
    """
    device = maps[0].device.type
    if device != "cpu" or not torch.is_autocast_enabled(device) or torch.is_grad_enabled():
        return torch.cat(maps, dim=1)
    dtype = torch.get_autocast_dtype(device)
    layout = torch.channels_last
    with torch.autocast(device, enabled=False):
        return torch.cat([one.to(dtype, memory_format=layout) for one in maps], dim=1)


def warp(features: torch.Tensor, motion_cells: torch.Tensor) -> torch.Tensor:
    """Warp the previous `features` (B,C,H,W) to the current sweep: sample them at p - m(p).

    `motion_cells` (B,2,H,W) is the displacement (x, y) = (columns, rows) of each cell between the
    sweeps. Bilinear, zeros outside of the grid.
    """
    height, width = features.shape[-2:]
    rows = torch.arange(height, device=features.device, dtype=motion_cells.dtype)
    columns = torch.arange(width, device=features.device, dtype=motion_cells.dtype)
    x = (columns[None, None, :] - motion_cells[:, 0] + 0.5) * (2.0 / width) - 1.0
    y = (rows[None, :, None] - motion_cells[:, 1] + 0.5) * (2.0 / height) - 1.0
    return functional.grid_sample(
        features,
        torch.stack((x, y), dim=-1).to(features.dtype),
        mode="bilinear",
        padding_mode="zeros",
        align_corners=False,
    )


def resize(motion: torch.Tensor, size: torch.Size) -> torch.Tensor:
    """Interpolate a displacement field (B,2,h,w) in metres bilinearly to `size` (H, W)."""
    return functional.interpolate(motion.float(), size=size, mode="bilinear", align_corners=False)


class Pyramid(nn.Module):
    """Feature pyramid shared by both sweeps: pseudo-image (B,C,H,W) -> a map a level."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        """Build the levels for a pseudo-image of `inputs` channels."""
        super().__init__()
        widths = (inputs, *config.pyramid_channels)
        strides = (config.stem_stride, *([2] * (config.levels - 1)))
        self.levels = nn.ModuleList(
            nn.Sequential(
                conv_block(before, after, stride=stride),
                *(conv_block(after, after) for _ in range(config.convs_per_level - 1)),
            )
            for before, after, stride in zip(widths, widths[1:], strides, strict=False)
        )

    def forward(
        self, image: torch.Tensor, *, first: int = 0, levels: int | None = None
    ) -> list[torch.Tensor]:
        """Return the feature maps of the levels, finest first.

        Args:
            image: (B,.,H,W) pseudo-images, or maps of the level before `first`.
            first: level to begin with.
            levels: number of the level to end before; None: all.
        """
        maps = []
        for level in list(self.levels)[first:levels]:
            image = level(image)
            maps.append(image)
        return maps


class Estimator(nn.Module):
    """Flow estimator of a level: (B,inputs,H,W) -> features (B,outputs,H,W), residual [m]."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        """Build the convolutions; `outputs` is the number of feature channels."""
        super().__init__()
        self.dense = config.dense
        self.layers = nn.ModuleList()
        for width in config.estimator_channels:
            self.layers.append(conv_block(inputs, width))
            inputs = inputs + width if self.dense else width
        self.outputs = inputs
        self.motion = small_init(nn.Conv2d(inputs, 2, 3, padding=1))

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return (features, residual displacement (B,2,H,W))."""
        for layer in self.layers:
            after = layer(features)
            features = torch.cat((after, features), dim=1) if self.dense else after
        return features, self.motion(features)


class Upsampler(nn.Module):
    """Displacement and features of a level at twice the resolution, for the next finer one."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        """Initialise the kernel of the displacement as bilinear interpolation."""
        super().__init__()
        self.motion = nn.ConvTranspose2d(2, 2, 4, 2, 1, bias=False)
        self.features = nn.ConvTranspose2d(inputs, config.upfeat_channels, 4, 2, 1)
        # the fine cell centres lie a quarter and three quarters between the coarse ones
        ramp = torch.tensor([0.25, 0.75, 0.75, 0.25])
        with torch.no_grad():
            self.motion.weight.zero_()
            for axis in range(2):
                self.motion.weight[axis, axis] = torch.outer(ramp, ramp)

    def forward(self, motion: torch.Tensor, features: torch.Tensor) -> list[torch.Tensor]:
        """Return [displacement, features], both (B,.,2H,2W)."""
        return [self.motion(motion), self.features(features)]


class Context(nn.Module):
    """Context network: dilated convolutions that refine the finest displacement."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        """Build one layer for each dilation; `outputs` is the number of feature channels."""
        super().__init__()
        widths = (inputs + 2, *config.context_channels)
        layers = zip(widths, widths[1:], config.context_dilations, strict=False)
        self.layers = nn.Sequential(
            *(conv_block(before, after, dilation=dilation) for before, after, dilation in layers)
        )
        for layer in self.layers.modules():
            if isinstance(layer, nn.LeakyReLU):
                layer.negative_slope = config.context_slope
        self.outputs = widths[-1]
        self.motion = small_init(nn.Conv2d(self.outputs, 2, 3, padding=1))

    def forward(
        self, features: torch.Tensor, motion: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return (refined displacement, features)."""
        wide = self.layers(concatenate([features, motion]))
        return motion + self.motion(wide), wide
