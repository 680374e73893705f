"""A FlowNet2-style backbone for the ablation (Table II): a correlation net and a stacked second.

Written from Dosovitskiy et al. (FlowNetC, ICCV 2015) and Ilg et al. (FlowNet 2.0, CVPR 2017):
FlowNetC correlates the two feature maps once, at a coarse stride, and decodes with skip links
(FlowNetSimple's refinement); FlowNet2 stacks a second net that sees the image, the image warped
by the first motion, that motion and the brightness error. Widths are a fraction of the 162 M
parameters of the original, so that it trains beside the others.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.cost_volume import cost_volume
from mottrack.flow.pillarflow.layers import LEAK, conv_block, small_init
from mottrack.flow.pillarflow.warping import warp

REACH = 3


class Refinement(nn.Module):
    """Decoder with skip links: a motion at each level, up-sampled into the next finer one."""

    def __init__(self, widths: tuple[int, ...]) -> None:
        """`widths` are those of the skipped maps, coarsest first."""
        super().__init__()
        inputs = [widths[0]] + [w + 26 for w in widths[1:]]
        self.layers = nn.ModuleList(conv_block(i, 24) for i in inputs)
        self.heads = nn.ModuleList(small_init(nn.Conv2d(24, 2, 3, padding=1)) for _ in inputs)
        self.lifts = nn.ModuleList(nn.ConvTranspose2d(24, 24, 4, 2, 1) for _ in inputs[1:])

    def forward(self, maps: list[torch.Tensor]) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Return motions, coarse to fine, and the finest features."""
        motions: list[torch.Tensor] = []
        evidence = maps[0]
        for index, (layer, head) in enumerate(zip(self.layers, self.heads, strict=True)):
            features = layer(evidence)
            motions.append(head(features))
            if index < len(self.lifts):
                lifted = functional.interpolate(
                    motions[-1].float(), scale_factor=2.0, mode="bilinear", align_corners=False
                )
                evidence = torch.cat((maps[index + 1], self.lifts[index](features), lifted), 1)
        return motions, features


class FlowNetDecoder(nn.Module):
    """Two pseudo-images -> motions in metres, coarse to fine, and the last features."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        """Build the correlation net and the stacked net."""
        super().__init__()
        fine, middle, coarse = config.pyramid_channels[:3]
        self.cell_m = config.cell_m
        self.fine = nn.Sequential(conv_block(inputs, fine), conv_block(fine, fine))
        self.middle = conv_block(fine, middle, stride=2)
        self.coarse = conv_block(middle, coarse, stride=2)
        self.joint = conv_block(coarse + (2 * REACH + 1) ** 2, 64)
        self.deep = conv_block(64, 80, stride=2)
        self.first = Refinement((80, 64, middle, fine))
        extra = 2 if config.visibility else 0
        self.second_fine = conv_block(2 * fine + 3 + extra, 24)
        self.second_middle = conv_block(24, 40, stride=2)
        self.second_coarse = conv_block(40, 56, stride=2)
        self.second = Refinement((56, 40, 24))
        self.outputs = 24

    def forward(
        self, current: torch.Tensor, previous: torch.Tensor, visibility: torch.Tensor | None
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Motions (B,2,h,w), coarse to fine, and the features beside the finest one."""
        half = current.shape[0]
        fine = self.fine(torch.cat((current, previous)))
        middle = self.middle(fine)
        coarse = self.coarse(middle)
        costs = cost_volume(coarse[:half].float(), coarse[half:].float(), REACH)
        joint = self.joint(torch.cat((coarse[:half], functional.leaky_relu(costs, LEAK)), 1))
        first, _ = self.first([self.deep(joint), joint, middle[:half], fine[:half]])
        again, features = self.second(self._second_maps(fine, first[-1], visibility))
        return [*first, *(m + f for m, f in zip(again, first[1:], strict=True))], features

    def _second_maps(
        self, fine: torch.Tensor, motion: torch.Tensor, visibility: torch.Tensor | None
    ) -> list[torch.Tensor]:
        half = fine.shape[0] // 2
        warped = warp(fine[half:].float(), motion.float() / self.cell_m)
        error = (fine[:half] - warped).abs().mean(1, keepdim=True)
        evidence = [fine[:half], warped, motion, error]
        if visibility is not None:
            evidence.append(visibility)
        one = self.second_fine(torch.cat(evidence, dim=1))
        two = self.second_middle(one)
        return [self.second_coarse(two), two, one]
