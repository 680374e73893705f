"""PillarFlow: two sweeps of points -> displacement and covariance of each cell (section III)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import nn

from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.decoder import OlderSweeps
from mottrack.flow.pillarflow.decoders import make_decoder
from mottrack.flow.pillarflow.layers import concatenate, conv_block
from mottrack.flow.pillarflow.pillars import DESCRIPTORS, CellGrid, network_cells


@dataclass(frozen=True)
class PointBatch:
    """Points of a batch of sweeps, in no order."""

    descriptors: torch.Tensor
    """(N,9) of `pillars.describe`."""
    cells: torch.Tensor
    """(N,) int64: flat index into (sweeps, rows, columns)."""
    sweeps: int
    """Number of sweeps."""
    rows: int
    """Rows of the grid of pillars."""
    columns: int
    """Columns of the same."""

    def to(self, device: torch.device) -> PointBatch:
        """Copy to a device."""
        descriptors = self.descriptors.to(device, non_blocking=True)
        cells = self.cells.to(device, non_blocking=True)
        return PointBatch(descriptors, cells, self.sweeps, self.rows, self.columns)


@dataclass(frozen=True)
class NetworkInput:
    """The sweeps of a batch of pairs, in the current ego frame."""

    current: PointBatch
    previous: PointBatch
    shares: torch.Tensor
    """(B,8,H,W) shares of a cell: unseen and seen-free of the current, then the previous sweep;
    then of its points, hidden from and passed by the other sweep, of the current, the previous."""
    older: tuple[PointBatch, ...] = ()
    """One for each of the network's older sweeps."""
    ratio: torch.Tensor | None = None
    """(B,S) time between the sweeps of the pair / age of each older sweep; 0: there is none."""

    def to(self, device: torch.device) -> NetworkInput:
        """Copy to a device."""
        return NetworkInput(
            self.current.to(device),
            self.previous.to(device),
            self.shares.to(device, non_blocking=True),
            tuple(one.to(device) for one in self.older),
            None if self.ratio is None else self.ratio.to(device, non_blocking=True),
        )


@dataclass(frozen=True)
class Estimate:
    """Output of the network, in metres over the interval between the sweeps."""

    motions: list[torch.Tensor]
    """(B,2,h,w) each, coarse to fine: displacement of current cells since the previous sweep."""
    factor: torch.Tensor
    """(B,3,h,w) Cholesky factor of the finest displacement's covariance, see `Uncertainty`."""


class PillarEncoder(nn.Module):
    """Linear + BatchNorm + ReLU for each point, maximum over its pillar, scatter (III-A).

    Dynamic pillars: no padding and no cap on pillars or points. A ReLU is never negative, so a
    scatter with `amax` into zeros is the maximum over the points and 0 for an empty pillar.
    """

    def __init__(self, channels: int) -> None:
        """Build the layer; `channels` is C of the pseudo-image."""
        super().__init__()
        self.channels = channels
        self.linear = nn.Linear(DESCRIPTORS, channels, bias=False)
        self.norm = nn.BatchNorm1d(channels)

    def forward(self, points: PointBatch) -> torch.Tensor:
        """Return the pseudo-image (B,C,H,W)."""
        embedded = torch.relu(self.norm(self.linear(points.descriptors))).float()
        image = embedded.new_zeros(points.sweeps * points.rows * points.columns, self.channels)
        index = points.cells[:, None].expand(-1, self.channels)
        image = image.scatter_reduce(0, index, embedded, "amax", include_self=True)
        image = image.view(points.sweeps, points.rows, points.columns, self.channels)
        return image.permute(0, 3, 1, 2)


class BinaryEncoder(nn.Module):
    """Binary occupancy: one channel, 1 where a cell has a point (section IV-C)."""

    def forward(self, points: PointBatch) -> torch.Tensor:
        """Return the occupancy (B,1,H,W)."""
        image = points.descriptors.new_zeros(points.sweeps * points.rows * points.columns)
        image[points.cells] = 1.0
        return image.view(points.sweeps, 1, points.rows, points.columns)


class Uncertainty(nn.Module):
    """Heteroscedastic head: features (B,C,H,W) -> Cholesky factor L of a covariance (B,3,H,W).

    The channels are (log L_xx, L_yx, log L_yy) in metres. The features arrive detached: the
    displacement is trained by its own loss alone.
    """

    log_range = (-5.0, 2.0)
    """Standard deviations from 7 mm, below a sensor's noise, to 7 m, beyond any match."""

    def __init__(self, *, inputs: int, width: int = 24) -> None:
        """Initialise near L = 0.1 m times the identity (log 0.1 = -2.3)."""
        super().__init__()
        self.hidden = conv_block(inputs, width)
        self.factor = nn.Conv2d(width, 3, 1)
        with torch.no_grad():
            # a tenth of torch's initial weights: the bias decides at first
            self.factor.weight.mul_(0.1)
            self.factor.bias.copy_(torch.tensor([-2.3, 0.0, -2.3]))  # type: ignore[union-attr]

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Return the factor, its logarithms clamped to `log_range`."""
        factor: torch.Tensor = self.factor(self.hidden(features.detach()))
        xx, yx, yy = (factor[:, i : i + 1] for i in range(3))
        return torch.cat((xx.clamp(*self.log_range), yx, yy.clamp(*self.log_range)), dim=1)


class BevFlowNet(nn.Module):
    """Pseudo-images (B,C,H,W) -> Estimate: the network behind the encoder."""

    def __init__(self, config: NetworkConfig) -> None:
        """Build the decoder that the configuration names and the uncertainty head."""
        super().__init__()
        self.visibility, self.sight, self.older = config.visibility, config.sight, config.older
        self.decoder = make_decoder(config, inputs=config.image_channels + config.image_shares)
        self.uncertainty = Uncertainty(inputs=self.decoder.outputs)

    def forward(
        self,
        current: torch.Tensor,
        previous: torch.Tensor,
        shares: torch.Tensor,
        older: torch.Tensor | None = None,
        ratio: torch.Tensor | None = None,
    ) -> Estimate:
        """Estimate the displacements.

        Args:
            current: (B,C,H,W) pseudo-image of the current sweep.
            previous: (B,C,H,W) the same of the previous sweep.
            shares: (B,8,H,W) as in `NetworkInput`.
            older: (B,S C,H,W) the same of the older sweeps, one after the other; None: there are
                none.
            ratio: (B,S) as in `NetworkInput`.
        """
        visible, sight = shares[:, :4], shares[:, 4:]
        beside = [visible] * self.visibility + [sight] * self.sight
        # shadow edges and what was passed are told to the estimators too, of both sweeps
        told = [visible[:, 2:]] * self.visibility + [sight] * self.sight
        seen = concatenate(told) if told else None
        history = None
        if self.older and older is not None and ratio is not None:
            nothing = [part.new_zeros(part[:, :2].shape) for part in beside]
            images = [concatenate([one, *nothing]) for one in older.chunk(self.older, dim=1)]
            history = OlderSweeps(images, ratio)
        current = concatenate([current, *(part[:, :2] for part in beside)])
        previous = concatenate([previous, *(part[:, 2:] for part in beside)])
        motions, features = self.decoder(current, previous, seen, history)
        return Estimate([m.float() for m in motions], self.uncertainty(features).float())


class PillarFlowNet(nn.Module):
    """Encoder and flow network as `config` describes them.

    Raises:
        InputError: the configuration names a backbone that does not exist.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.encoder: PillarEncoder | BinaryEncoder = (
            PillarEncoder(config.pillar_channels)
            if config.encoder == "pillars"
            else BinaryEncoder()
        )
        self.flow = BevFlowNet(config)

    def forward(self, pair: NetworkInput) -> Estimate:
        """Estimate the displacement of the current sweep's cells."""
        current, previous = self.encoder(pair.current), self.encoder(pair.previous)
        count = self.config.older if pair.older else 0
        if count > len(pair.older):
            raise InputError("older sweeps", len(pair.older), f"0 or {count}")
        older = [self.encoder(one) for one in pair.older[:count]]
        ratio = pair.ratio[:, :count] if older and pair.ratio is not None else None
        estimate: Estimate = self.flow(
            current, previous, pair.shares, torch.cat(older, dim=1) if older else None, ratio
        )
        return estimate

    def cells(self, grid: BevGrid) -> CellGrid:
        """Return the network's own cells over `grid`, a multiple of its coarsest stride."""
        multiple = self.config.strides[-1] * self.flow.decoder.extra_stride
        return network_cells(grid, self.config.cell_m, multiple)
