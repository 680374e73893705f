"""PillarFlow: two sweeps of points in, a motion and its uncertainty for each cell out."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import nn

from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.flownet import FlowNetDecoder
from mottrack.flow.pillarflow.layers import side_by_side
from mottrack.flow.pillarflow.pillar_net import BinaryEncoder, PillarEncoder, Points
from mottrack.flow.pillarflow.pwc import PwcDecoder
from mottrack.flow.pillarflow.spynet import SpyNetDecoder
from mottrack.flow.pillarflow.uncertainty import Uncertainty

Decoder = PwcDecoder | SpyNetDecoder | FlowNetDecoder
DECODERS: dict[str, type[Decoder]] = {
    "pwc": PwcDecoder,
    "spynet": SpyNetDecoder,
    "flownet": FlowNetDecoder,
}


@dataclass(frozen=True)
class Estimate:
    """What the network says, in metres over the interval between the sweeps."""

    motions: list[torch.Tensor]
    """(B,2,h,w) each, coarse to fine: way of each current cell since the previous sweep."""
    factor: torch.Tensor
    """(B,3,h,w): Cholesky factor of the finest motion's covariance (`uncertainty`)."""


@dataclass(frozen=True)
class SweepPair:
    """The network's input: both sweeps in the current ego frame."""

    current: Points
    previous: Points
    visibility: torch.Tensor
    """(B,4,H,W): unseen and seen-free of the current, then of the previous sweep; 0 or 1."""

    def to(self, device: torch.device) -> SweepPair:
        """Copy to a device."""
        visibility = self.visibility.to(device, non_blocking=True)
        return SweepPair(self.current.to(device), self.previous.to(device), visibility)


class BevFlowNet(nn.Module):
    """Two pseudo-images (B,C,H,W) -> Estimate: all of the network behind the encoder."""

    def __init__(self, config: NetworkConfig) -> None:
        """Build the decoder that the configuration names and the uncertainty head."""
        super().__init__()
        self.visibility = config.visibility
        channels = config.pillar_channels if config.encoder == "pillars" else 1
        inputs = channels + (2 if config.visibility else 0)
        decoder = DECODERS[config.backbone](config, inputs=inputs)
        self.decoder = decoder
        self.uncertainty = Uncertainty(inputs=int(decoder.outputs))

    def forward(
        self, current: torch.Tensor, previous: torch.Tensor, visibility: torch.Tensor
    ) -> Estimate:
        """Estimate; `visibility` (B,4,H,W) as in SweepPair."""
        beside = None
        if self.visibility:
            current = side_by_side([current, visibility[:, :2]])
            previous = side_by_side([previous, visibility[:, 2:]])
            beside = visibility[:, 2:]
        motions, features = self.decoder(current, previous, beside)
        return Estimate([m.float() for m in motions], self.uncertainty(features).float())


class PillarFlowNet(nn.Module):
    """Encoder and flow network: the class behind every preset."""

    def __init__(self, config: NetworkConfig) -> None:
        """Build the network that `config` describes."""
        super().__init__()
        self.config = config
        self.encoder: PillarEncoder | BinaryEncoder = (
            PillarEncoder(config.pillar_channels)
            if config.encoder == "pillars"
            else BinaryEncoder()
        )
        self.flow = BevFlowNet(config)

    def forward(self, pair: SweepPair) -> Estimate:
        """Estimate the motion of the current sweep's cells."""
        estimate: Estimate = self.flow(
            self.encoder(pair.current), self.encoder(pair.previous), pair.visibility
        )
        return estimate
