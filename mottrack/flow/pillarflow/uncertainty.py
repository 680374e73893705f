"""The heteroscedastic head: how far off the motion of each cell may be."""

from __future__ import annotations

import torch
from torch import nn

from mottrack.flow.pillarflow.layers import conv_block

LOG_FLOOR, LOG_CEILING = -5.0, 2.0


class Uncertainty(nn.Module):
    """Features (B,C,H,W) -> lower Cholesky factor of the motion's covariance (B,3,H,W).

    The channels are (log L_xx, L_yx, log L_yy) in metres. The features arrive detached: the
    motion is trained by its own loss alone.
    """

    def __init__(self, *, inputs: int, width: int = 24) -> None:
        """Start near L = 0.1 m times the identity."""
        super().__init__()
        self.hidden = conv_block(inputs, width)
        self.factor = nn.Conv2d(width, 3, 1)
        with torch.no_grad():
            self.factor.weight.mul_(0.1)
            self.factor.bias.copy_(torch.tensor([-2.3, 0.0, -2.3]))  # type: ignore[union-attr]

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Return the factor's channels, the logarithms kept within [-5, 2]."""
        factor: torch.Tensor = self.factor(self.hidden(features.detach()))
        first, cross, second = (factor[:, i : i + 1] for i in range(3))
        first, second = (one.clamp(LOG_FLOOR, LOG_CEILING) for one in (first, second))
        return torch.cat((first, cross, second), dim=1)
