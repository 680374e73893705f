"""The feature pyramid that both sweeps share (paper, section III-B)."""

from __future__ import annotations

import torch
from torch import nn

from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.layers import conv_block


class Pyramid(nn.Module):
    """Pseudo-image (B,C,H,W) -> one feature map a level, finest first."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        """Build the levels; `inputs` counts the channels of the pseudo-image."""
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

    def forward(self, image: torch.Tensor) -> list[torch.Tensor]:
        """Return the maps of all levels, finest first."""
        maps = []
        for level in self.levels:
            image = level(image)
            maps.append(image)
        return maps
