"""Flow networks behind the encoder: PWC (section III-B), SpyNet and FlowNet2 (Table II), presets.

To add a network, write a subclass of `Decoder` and enter it in `DECODERS` and `PRESETS` below; no
other file names one.
"""

from __future__ import annotations

from itertools import pairwise
from typing import ClassVar, NamedTuple

import torch
from torch import nn
from torch.nn import functional

from mottrack.core.errors import InputError
from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.cost_volume import cost_volume
from mottrack.flow.pillarflow.layers import (
    LEAK,
    Context,
    Estimator,
    Pyramid,
    Upsampler,
    concatenate,
    conv_block,
    resize,
    small_init,
    warp,
)


class OlderSweeps(NamedTuple):
    """Older sweeps of a batch of pairs."""

    images: list[torch.Tensor]
    """(B,C,H,W) pseudo-image of each, from the youngest to the oldest."""
    ratio: torch.Tensor
    """(B,S) time between the sweeps of the pair / age of each; 0: that pair has none."""

    def present(self, index: int) -> torch.Tensor:
        """Return (B,1,1,1) 1 where the pair has this one, else 0."""
        return (self.ratio[:, index] > 0).to(self.ratio.dtype)[:, None, None, None]

    def extrapolated(self, motion: torch.Tensor, index: int) -> torch.Tensor:
        """Return a displacement (B,2,h,w) of the pair continued back to this sweep, in metres."""
        # an absent sweep has the ratio 0: its motion is not continued, and its maps are masked
        ratio = self.ratio[:, index].where(self.ratio[:, index] > 0, 1.0)
        return motion / ratio[:, None, None, None]


class Decoder(nn.Module):
    """Two pseudo-images -> displacements and features; the interface of every network here.

    Constructed from the configuration and `inputs`, the number of channels of a pseudo-image.
    """

    extra_stride: ClassVar[int] = 1
    """Stride of the coarsest internal map relative to the coarsest pyramid level."""
    outputs: int
    """Number of channels of the features that leave the network."""

    def forward(
        self,
        current: torch.Tensor,
        previous: torch.Tensor,
        shares: torch.Tensor | None,
        older: OlderSweeps | None,
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Return the displacements, coarse to fine, and the features of the finest level.

        Args:
            current: (B,C,H,W) pseudo-image of the current sweep.
            previous: (B,C,H,W) the same of the previous sweep.
            shares: (B,told_shares,H,W) unseen and seen-free share of the previous sweep's cells and
                what either sweep saw of the other's points, as far as used, or None.
            older: the older sweeps; None where there are none.

        Returns:
            Displacements (B,2,h,w) in metres of the current cells since the previous sweep, and
            features (B,outputs,h,w) of the last of them.
        """
        raise NotImplementedError


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


DECODERS: dict[str, type[Decoder]] = {
    "pwc": PwcDecoder,
    "spynet": SpyNetDecoder,
    "flownet": FlowNetDecoder,
}

PRESETS: dict[str, NetworkConfig] = {
    "small": NetworkConfig(
        pillar_channels=16,
        stem_stride=2,
        pyramid_channels=(24, 32, 48),
        estimator_channels=(32, 24, 24),
    ),
    "base": NetworkConfig(),
    "base_history": NetworkConfig(sight=True, older_ages_s=(0.3, 0.5)),
    "paper": NetworkConfig(
        cell_m=0.25,
        pillar_channels=64,
        stem_stride=2,
        pyramid_channels=(16, 32, 64, 96, 128, 196),
        convs_per_level=3,
        finest_level=1,
        displacement=4,
        match_channels=0,
        estimator_channels=(128, 128, 96, 64, 32),
        dense=True,
        upfeat_channels=2,
        context_channels=(128, 128, 128, 96, 64, 32),
        context_dilations=(1, 2, 4, 8, 16, 1),
        context_slope=0.0,
    ),
    "binary_ogm": NetworkConfig(encoder="binary", pillar_channels=1, visibility=False),
    "spynet": NetworkConfig(backbone="spynet", pyramid_channels=(24, 24, 24)),
    "flownet": NetworkConfig(backbone="flownet"),
}
"""Named networks: three sizes of PillarFlow (`paper` as published), `base` with older sweeps and
three-dimensional visibility, the binary baseline of IV-C and two older backbones."""


def preset(name: str) -> NetworkConfig:
    """Return the network called `name`.

    Raises:
        InputError: there is none of that name; the error lists the valid ones.
    """
    if name not in PRESETS:
        raise InputError("network", name, f"one of {', '.join(PRESETS)}")
    return PRESETS[name]


def make_decoder(config: NetworkConfig, *, inputs: int) -> Decoder:
    """Build the decoder that `config.backbone` names.

    Raises:
        InputError: there is none of that name; the error lists the valid ones.
    """
    if config.backbone not in DECODERS:
        raise InputError("backbone", config.backbone, f"one of {', '.join(DECODERS)}")
    return DECODERS[config.backbone](config, inputs=inputs)
