"""The encoders: points -> BeV pseudo-image, for training (paper, sections III-A and IV-C)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import nn

from mottrack.flow.pillarflow.descriptors import DESCRIPTORS


@dataclass(frozen=True)
class Points:
    """Points of a batch of sweeps, in no order."""

    descriptors: torch.Tensor
    """(N,9) of `descriptors.describe`."""
    cells: torch.Tensor
    """(N,) int64: flat index into (batch, rows, columns)."""
    shape: tuple[int, int, int]
    """(batch, rows, columns)."""

    def to(self, device: torch.device) -> Points:
        """Copy to a device."""
        descriptors = self.descriptors.to(device, non_blocking=True)
        return Points(descriptors, self.cells.to(device, non_blocking=True), self.shape)


class PillarEncoder(nn.Module):
    """Linear + BatchNorm + ReLU for each point, maximum over its pillar, scatter to (B,C,H,W).

    Dynamic pillars: no padding and no cap on pillars or points. A ReLU is never negative, so a
    scatter with `amax` into zeros is the maximum over the points and 0 for an empty pillar.
    """

    def __init__(self, channels: int) -> None:
        """`channels` is C."""
        super().__init__()
        self.channels = channels
        self.linear = nn.Linear(DESCRIPTORS, channels, bias=False)
        self.norm = nn.BatchNorm1d(channels)

    def forward(self, points: Points) -> torch.Tensor:
        """Return the pseudo-image."""
        batch, rows, columns = points.shape
        embedded = torch.relu(self.norm(self.linear(points.descriptors))).float()
        image = embedded.new_zeros(batch * rows * columns, self.channels)
        index = points.cells[:, None].expand(-1, self.channels)
        image = image.scatter_reduce(0, index, embedded, "amax", include_self=True)
        return image.view(batch, rows, columns, self.channels).permute(0, 3, 1, 2)


class BinaryEncoder(nn.Module):
    """One channel: is there any point in the cell (section IV-C)."""

    channels = 1

    def forward(self, points: Points) -> torch.Tensor:
        """Return the occupancy as 0 and 1."""
        batch, rows, columns = points.shape
        image = points.descriptors.new_zeros(batch * rows * columns)
        image[points.cells] = 1.0
        return image.view(batch, 1, rows, columns)
