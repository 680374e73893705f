"""The coarse-to-fine decoder: warp, correlate, estimate, up-sample, refine (section III-B)."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.context import Context
from mottrack.flow.pillarflow.cost_volume import cost_volume
from mottrack.flow.pillarflow.estimator import Estimator, Upsampler
from mottrack.flow.pillarflow.layers import LEAK, side_by_side
from mottrack.flow.pillarflow.pyramid import Pyramid
from mottrack.flow.pillarflow.warping import warp


class Level(nn.Module):
    """One level of the decoder."""

    def __init__(self, config: NetworkConfig, *, level: int) -> None:
        """Count the evidence of this level; the coarsest one has no motion to start from."""
        super().__init__()
        features = config.pyramid_channels[level]
        self.coarsest = level == config.levels - 1
        self.cells_a_metre = 1.0 / (config.cell_m * config.strides[level])
        self.reach, self.rest = config.displacement, config.rest_displacement
        matched = config.match_channels
        self.project = nn.Conv2d(features, matched, 1) if matched else nn.Identity()
        evidence = (2 * self.reach + 1) ** 2 + features + (2 if config.visibility else 0)
        if not self.coarsest:
            evidence += (2 * self.rest + 1) ** 2 + 2 + config.upfeat_channels
        self.estimator = Estimator(config, inputs=evidence)

    def costs(
        self, one: torch.Tensor, two: torch.Tensor, motion: torch.Tensor | None
    ) -> list[torch.Tensor]:
        """Cost volume around the motion so far and, below the coarsest level, around rest."""
        one, two = self.project(one).float(), self.project(two).float()
        if motion is None:
            volumes = [cost_volume(one, two, self.reach)]
        else:
            warped = warp(two, motion.float() * self.cells_a_metre)
            volumes = [cost_volume(one, warped, self.reach), cost_volume(one, two, self.rest)]
        return [functional.leaky_relu(volume, LEAK) for volume in volumes]

    def forward(
        self,
        one: torch.Tensor,
        two: torch.Tensor,
        lifted: list[torch.Tensor],
        beside: list[torch.Tensor],
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Features and motion from both maps, the lifted (motion, features) and what is beside."""
        start = lifted[0] if lifted else None
        evidence = [*self.costs(one, two, start), one, *lifted, *beside]
        features, residual = self.estimator(side_by_side(evidence))
        return features, residual if start is None else start + residual


class PwcDecoder(nn.Module):
    """Two pseudo-images (B,C,H,W) -> motions in metres, coarse to fine, and fine features."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        """Build the pyramid and a decoder for each level down to `finest_level`."""
        super().__init__()
        self.pyramid = Pyramid(config, inputs=inputs)
        self.strides, self.finest = config.strides, config.finest_level
        order = range(config.levels - 1, config.finest_level - 1, -1)
        levels = [Level(config, level=level) for level in order]
        self.levels = nn.ModuleList(levels)
        widths = [level.estimator.outputs for level in levels]
        self.upsamplers = nn.ModuleList(Upsampler(config, inputs=w) for w in widths[:-1])
        self.context = Context(config, inputs=widths[-1])
        self.outputs = self.context.outputs

    def encode(self, image: torch.Tensor) -> list[torch.Tensor]:
        """Pyramid of one sweep, coarsest first, down to the finest decoded level."""
        maps: list[torch.Tensor] = self.pyramid(image)
        return maps[self.finest :][::-1]

    def decode(
        self,
        current: list[torch.Tensor],
        previous: list[torch.Tensor],
        visibility: torch.Tensor | None,
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Estimate the motion level by level; `visibility` (B,2,H,W) is the previous sweep's."""
        motions: list[torch.Tensor] = []
        lifted: list[torch.Tensor] = []
        strides = self.strides[self.finest :][::-1]
        for index, (level, one, two) in enumerate(zip(self.levels, current, previous, strict=True)):
            beside = (
                [] if visibility is None else [functional.avg_pool2d(visibility, strides[index])]
            )
            features, motion = level(one, two, lifted, beside)
            motions.append(motion)
            if index < len(self.upsamplers):
                lifted = list(self.upsamplers[index](motions[-1], features))
        refined, wide = self.context(features, motions[-1])
        motions[-1] = refined
        return motions, wide

    def forward(
        self, current: torch.Tensor, previous: torch.Tensor, visibility: torch.Tensor | None
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Motions (B,2,h,w), coarse to fine, and the features beside the finest one."""
        maps = self.encode(torch.cat((current, previous)))
        half = current.shape[0]
        return self.decode([m[:half] for m in maps], [m[half:] for m in maps], visibility)
