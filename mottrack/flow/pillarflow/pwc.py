"""PWC, the flow network of PillarFlow (section III-B)."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.cost_volume import cost_volume
from mottrack.flow.pillarflow.decoder import Decoder, OlderSweeps
from mottrack.flow.pillarflow.layers import (
    LEAK,
    Context,
    Estimator,
    Pyramid,
    Upsampler,
    concatenate,
    warp,
)


class PwcLevel(nn.Module):
    """One level of PWC: warp, correlate, estimate."""

    def __init__(self, config: NetworkConfig, *, level: int) -> None:
        """Build the level; the coarsest one has no displacement to start from."""
        super().__init__()
        features = config.pyramid_channels[level]
        self.cells_per_m = 1.0 / (config.cell_m * config.strides[level])
        self.radius, self.zero_radius = config.displacement, config.rest_displacement
        matched = config.match_channels
        self.project = nn.Conv2d(features, matched, 1) if matched else nn.Identity()
        inputs = (2 * self.radius + 1) ** 2 + features + config.told_shares
        if level < config.levels - 1:
            inputs += (2 * self.zero_radius + 1) ** 2 + 2 + config.upfeat_channels
        self.older = config.older if level == config.finest_level < config.levels - 1 else 0
        self.older_radius = config.older_displacement
        inputs += self.older * ((2 * self.older_radius + 1) ** 2 + 1)
        self.estimator = Estimator(config, inputs=inputs)

    def costs(
        self, current: torch.Tensor, previous: torch.Tensor, motion: torch.Tensor | None
    ) -> list[torch.Tensor]:
        """Return the cost volume around the displacement so far and, if any, around zero."""
        current, previous = self.project(current).float(), self.project(previous).float()
        if motion is None:
            volumes = [cost_volume(current, previous, self.radius)]
        else:
            warped = warp(previous, motion.float() * self.cells_per_m)
            volumes = [
                cost_volume(current, warped, self.radius),
                cost_volume(current, previous, self.zero_radius),
            ]
        return [functional.leaky_relu(volume, LEAK) for volume in volumes]

    def older_costs(
        self, current: torch.Tensor, older: OlderSweeps | None, motion: torch.Tensor
    ) -> list[torch.Tensor]:
        """Return the cost volume of each older sweep and its ratio, zero where it is absent.

        The first is warped along the displacement continued to its age: an error of the velocity
        is several times as large there. The others are compared around zero motion, where what
        moves slowly has moved by a cell.

        Args:
            current: (B,C,h,w) feature map of the current sweep.
            older: their feature maps in place of images; None where there are none.
            motion: (B,2,h,w) displacement so far.
        """
        volume = (2 * self.older_radius + 1) ** 2
        if older is None:
            batch, _, *size = current.shape
            return [current.new_zeros(batch, self.older * (volume + 1), *size)]
        current, costs = self.project(current).float(), []
        for index, image in enumerate(older.images):
            then = self.project(image).float()
            if index == 0:
                way_m = older.extrapolated(motion.float(), index)
                then = warp(then, way_m * self.cells_per_m)
            found = cost_volume(current, then, self.older_radius)
            costs.append(functional.leaky_relu(found, LEAK) * older.present(index))
            ratio = older.ratio[:, index, None, None, None].expand_as(found[:, :1])
            costs.append(ratio)
        return costs

    def forward(
        self,
        current: torch.Tensor,
        previous: torch.Tensor,
        upsampled: list[torch.Tensor],
        shares: list[torch.Tensor],
        older: OlderSweeps | None,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return (features, displacement).

        Args:
            current: (B,C,h,w) feature map of the current sweep.
            previous: (B,C,h,w) the same of the previous sweep.
            upsampled: [displacement, features] of the next coarser level; empty at the coarsest.
            shares: [(B,told_shares,h,w)], or empty.
            older: feature maps of the older sweeps at this level; used at the finest alone.
        """
        start = upsampled[0] if upsampled else None
        maps = [*self.costs(current, previous, start), current, *upsampled, *shares]
        if self.older and start is not None:
            maps += self.older_costs(current, older, start)
        features, residual = self.estimator(concatenate(maps))
        return features, residual if start is None else start + residual


class PwcDecoder(Decoder):
    """Coarse-to-fine decoder over a shared feature pyramid (section III-B, after PWC-Net)."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        super().__init__()
        self.pyramid = Pyramid(config, inputs=inputs)
        self.finest, self.strides = config.finest_level, config.strides[config.finest_level :][::-1]
        order = range(config.levels - 1, config.finest_level - 1, -1)
        levels = [PwcLevel(config, level=level) for level in order]
        self.levels = nn.ModuleList(levels)
        widths = [level.estimator.outputs for level in levels]
        self.upsamplers = nn.ModuleList(Upsampler(config, inputs=w) for w in widths[:-1])
        self.context = Context(config, inputs=widths[-1])
        self.outputs = self.context.outputs

    def forward(
        self,
        current: torch.Tensor,
        previous: torch.Tensor,
        shares: torch.Tensor | None,
        older: OlderSweeps | None,
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Estimate the displacement level by level and refine the finest one by its context."""
        batch = current.shape[0]
        maps, history = self._maps(torch.cat((current, previous)), older)
        motions: list[torch.Tensor] = []
        upsampled: list[torch.Tensor] = []
        for index, (level, both) in enumerate(zip(self.levels, maps, strict=True)):
            seen = [] if shares is None else [functional.avg_pool2d(shares, self.strides[index])]
            features, motion = level(both[:batch], both[batch:], upsampled, seen, history)
            motions.append(motion)
            if index < len(self.upsamplers):
                upsampled = self.upsamplers[index](motion, features)
        motions[-1], features = self.context(features, motions[-1])
        return motions, features

    def _maps(
        self, both: torch.Tensor, older: OlderSweeps | None
    ) -> tuple[list[torch.Tensor], OlderSweeps | None]:
        """Return the pyramid of both sweeps, coarse to fine, and the finest maps of older ones.

        All pass the finest levels together, so that a batch normalisation sees one distribution.
        """
        if older is None:
            return self.pyramid(both)[self.finest :][::-1], None
        fine = self.pyramid(torch.cat((both, *older.images)), levels=self.finest + 1)
        pair = len(both)
        history = list(fine[-1][pair:].chunk(len(older.images)))
        coarse = self.pyramid(fine[-1][:pair], first=self.finest + 1)
        maps = [fine[-1][:pair], *coarse]
        return maps[::-1], older._replace(images=history)
