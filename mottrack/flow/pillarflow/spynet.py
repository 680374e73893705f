"""A SpyNet-style decoder for the ablation (Table II): a residual pyramid of large kernels.

Written from Ranjan and Black, "Optical Flow Estimation using a Spatial Pyramid Network"
(CVPR 2017): at each level one stack of 7x7 convolutions sees the current image, the warped
previous image and the motion so far, and predicts what is missing. No cost volume.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.layers import conv_block, small_init
from mottrack.flow.pillarflow.warping import warp

WIDTHS = (32, 64, 32, 16)


class SpyNetDecoder(nn.Module):
    """Two pseudo-images -> motions in metres, coarse to fine, and the last features."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        """Build one stack a level; images are pooled, not encoded."""
        super().__init__()
        self.cell_m, self.strides = config.cell_m, config.strides[::-1]
        extra = 2 + (2 if config.visibility else 0)
        self.stacks = nn.ModuleList(self._stack(2 * inputs + extra) for _ in self.strides)
        self.heads = nn.ModuleList(
            small_init(nn.Conv2d(WIDTHS[-1], 2, 7, padding=3)) for _ in self.strides
        )
        self.outputs = WIDTHS[-1]

    @staticmethod
    def _stack(inputs: int) -> nn.Sequential:
        widths = (inputs, *WIDTHS)
        pairs = pairwise(widths)
        return nn.Sequential(*(conv_block(a, b, kernel=7) for a, b in pairs))

    def forward(
        self, current: torch.Tensor, previous: torch.Tensor, visibility: torch.Tensor | None
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Motions (B,2,h,w), coarse to fine, and the features beside the finest one."""
        motions: list[torch.Tensor] = []
        for stride, stack, head in zip(self.strides, self.stacks, self.heads, strict=True):
            one, two = (functional.avg_pool2d(i.float(), stride) for i in (current, previous))
            motion = self._start(motions, one)
            warped = warp(two, motion / (self.cell_m * stride))
            evidence = [one, warped, motion]
            if visibility is not None:
                evidence.append(functional.avg_pool2d(visibility, stride))
            features = stack(torch.cat(evidence, dim=1))
            motions.append(motion + head(features))
        return motions, features

    @staticmethod
    def _start(motions: list[torch.Tensor], image: torch.Tensor) -> torch.Tensor:
        if not motions:
            return image.new_zeros(image.shape[0], 2, *image.shape[-2:])
        size = image.shape[-2:]
        return functional.interpolate(
            motions[-1].float(), size=size, mode="bilinear", align_corners=False
        )
