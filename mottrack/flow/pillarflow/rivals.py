"""The flow networks that Table II compares with PWC: SpyNet and FlowNet2."""

from __future__ import annotations

from itertools import pairwise
from typing import ClassVar

import torch
from torch import nn
from torch.nn import functional

from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.cost_volume import cost_volume
from mottrack.flow.pillarflow.decoder import Decoder, OlderSweeps
from mottrack.flow.pillarflow.layers import LEAK, conv_block, resize, small_init, warp


class SpyNetDecoder(Decoder):
    """Residual pyramid of large kernels, without a cost volume (Table II).

    Written from Ranjan and Black, "Optical Flow Estimation using a Spatial Pyramid Network"
    (CVPR 2017): at each level one stack of 7x7 convolutions takes the current image, the warped
    previous image and the displacement so far, and predicts the residual. Images are pooled, not
    encoded.
    """

    widths: ClassVar[tuple[int, ...]] = (32, 64, 32, 16)
    """Channels of a stack, as in the publication."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        super().__init__()
        self.cell_m, self.strides = config.cell_m, config.strides[::-1]
        inputs = (2 + config.older) * inputs + 2 + config.told_shares
        self.older = config.older
        self.outputs = self.widths[-1]
        self.stacks = nn.ModuleList(
            nn.Sequential(
                *(conv_block(a, b, kernel=7) for a, b in pairwise((inputs, *self.widths)))
            )
            for _ in self.strides
        )
        self.heads = nn.ModuleList(
            small_init(nn.Conv2d(self.outputs, 2, 7, padding=3)) for _ in self.strides
        )

    def forward(
        self,
        current: torch.Tensor,
        previous: torch.Tensor,
        shares: torch.Tensor | None,
        older: OlderSweeps | None,
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Add a residual displacement at each level of the image pyramid."""
        motions: list[torch.Tensor] = []
        for stride, stack, head in zip(self.strides, self.stacks, self.heads, strict=True):
            one, two = (functional.avg_pool2d(i.float(), stride) for i in (current, previous))
            size = one.shape[-2:]
            motion = resize(motions[-1], size) if motions else one.new_zeros(one.shape[0], 2, *size)
            maps = [one, warp(two, motion / (self.cell_m * stride)), motion]
            if shares is not None:
                maps.append(functional.avg_pool2d(shares, stride))
            maps += self._older_maps(one, older, motion, stride)
            features = stack(torch.cat(maps, dim=1))
            motions.append(motion + head(features))
        return motions, features

    def _older_maps(
        self, one: torch.Tensor, older: OlderSweeps | None, motion: torch.Tensor, stride: int
    ) -> list[torch.Tensor]:
        """Return the image of each older sweep, warped along the continued displacement."""
        if older is None:
            return [torch.zeros_like(one)] * self.older
        return [
            warp(
                functional.avg_pool2d(image.float(), stride),
                older.extrapolated(motion, index) / (self.cell_m * stride),
            )
            * older.present(index)
            for index, image in enumerate(older.images)
        ]


class Refinement(nn.Module):
    """FlowNetSimple's refinement: a displacement at each level, up-sampled into the finer one."""

    width: ClassVar[int] = 24
    """Channels of each level, in place of the 64 to 512 of the publication."""

    def __init__(self, *skipped: int) -> None:
        """Build a level for each skipped map; `skipped` are their channels, coarsest first."""
        super().__init__()
        inputs = [skipped[0]] + [channels + self.width + 2 for channels in skipped[1:]]
        self.layers = nn.ModuleList(conv_block(i, self.width) for i in inputs)
        self.heads = nn.ModuleList(
            small_init(nn.Conv2d(self.width, 2, 3, padding=1)) for _ in inputs
        )
        self.lifts = nn.ModuleList(
            nn.ConvTranspose2d(self.width, self.width, 4, 2, 1) for _ in inputs[1:]
        )

    def forward(self, maps: list[torch.Tensor]) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Return the displacements, coarse to fine, and the finest features."""
        features = self.layers[0](maps[0])
        motions = [self.heads[0](features)]
        for skipped, up, layer, head in zip(
            maps[1:], self.lifts, self.layers[1:], self.heads[1:], strict=True
        ):
            finer = up(features)
            features = layer(torch.cat((skipped, finer, resize(motions[-1], finer.shape[-2:])), 1))
            motions.append(head(features))
        return motions, features


class FlowNetDecoder(Decoder):
    """A correlation network and a stacked second one (Table II).

    Written from Dosovitskiy et al. (FlowNetC, ICCV 2015) and Ilg et al. (FlowNet 2.0, CVPR 2017):
    FlowNetC correlates the two feature maps once, at a coarse stride, and decodes with skip links;
    FlowNet2 stacks a second network on the features, those warped by the first displacement, that
    displacement and the brightness error. Widths are a fraction of the 162 M parameters of the
    original, so that it trains beside the others.
    """

    extra_stride: ClassVar[int] = 2
    radius: ClassVar[int] = 3
    """Search radius of the cost volume at the third level [cells]: 3 x 2 m for 0.5 m pillars."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        super().__init__()
        self.cell_m = config.cell_m
        fine, middle, coarse = config.pyramid_channels[:3]
        self.fine = nn.Sequential(conv_block(inputs, fine), conv_block(fine, fine))
        self.middle = conv_block(fine, middle, stride=2)
        self.coarse = conv_block(middle, coarse, stride=2)
        self.joint = conv_block(coarse + (2 * self.radius + 1) ** 2, 64)
        self.deep = conv_block(64, 80, stride=2)
        self.first = Refinement(80, 64, middle, fine)
        self.older = config.older
        self.second_fine = conv_block(2 * fine + 3 + config.told_shares + config.older, 24)
        self.second_middle = conv_block(24, 40, stride=2)
        self.second_coarse = conv_block(40, 56, stride=2)
        self.second = Refinement(56, 40, 24)
        self.outputs = Refinement.width

    def forward(
        self,
        current: torch.Tensor,
        previous: torch.Tensor,
        shares: torch.Tensor | None,
        older: OlderSweeps | None,
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Estimate with the correlation network, then add the second network's residual."""
        batch = current.shape[0]
        images = [] if older is None else older.images
        every = self.fine(torch.cat((current, previous, *images)))
        fine, history = every[: 2 * batch], None
        if older is not None:
            history = older._replace(images=list(every[2 * batch :].chunk(len(images))))
        middle = self.middle(fine)
        coarse = self.coarse(middle)
        costs = cost_volume(coarse[:batch].float(), coarse[batch:].float(), self.radius)
        joint = self.joint(torch.cat((coarse[:batch], functional.leaky_relu(costs, LEAK)), 1))
        first, _ = self.first([self.deep(joint), joint, middle[:batch], fine[:batch]])
        second, features = self.second(self._second_maps(fine, first[-1], shares, history))
        return [*first, *(m + f for m, f in zip(second, first[1:], strict=True))], features

    def _second_maps(
        self,
        fine: torch.Tensor,
        motion: torch.Tensor,
        shares: torch.Tensor | None,
        older: OlderSweeps | None,
    ) -> list[torch.Tensor]:
        """Return the maps of the second network, coarsest first."""
        batch = fine.shape[0] // 2
        current = fine[:batch]
        warped = warp(fine[batch:].float(), motion.float() / self.cell_m)
        error = (current - warped).abs().mean(1, keepdim=True)
        maps = [current, warped, motion, error]
        if shares is not None:
            maps.append(shares)
        if older is None:
            maps += [torch.zeros_like(error)] * self.older
        else:
            for index, image in enumerate(older.images):
                way_m = older.extrapolated(motion.float(), index)
                warped = warp(image.float(), way_m / self.cell_m)
                error = (current - warped).abs().mean(1, keepdim=True)
                maps.append(error * older.present(index))
        one = self.second_fine(torch.cat(maps, dim=1))
        two = self.second_middle(one)
        return [self.second_coarse(two), two, one]
