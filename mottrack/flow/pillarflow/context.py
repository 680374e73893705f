"""The context network: dilated convolutions that refine the finest motion (section III-B)."""

from __future__ import annotations

import torch
from torch import nn

from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.layers import conv_block, side_by_side, small_init


class Context(nn.Module):
    """(features, motion) of the finest level -> (refined motion, features)."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        """Build one layer for each dilation."""
        super().__init__()
        widths = (inputs + 2, *config.context_channels)
        layers = zip(widths, widths[1:], config.context_dilations, strict=False)
        self.layers = nn.Sequential(
            *(conv_block(before, after, dilation=step) for before, after, step in layers)
        )
        self.outputs = widths[-1]
        self.motion = small_init(nn.Conv2d(self.outputs, 2, 3, padding=1))

    def forward(
        self, features: torch.Tensor, motion: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Add what the wider view says to the motion."""
        wide = self.layers(side_by_side([features, motion]))
        return motion + self.motion(wide), wide
