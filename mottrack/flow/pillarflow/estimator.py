"""The flow estimator of one level and the bridge to the next finer one."""

from __future__ import annotations

import torch
from torch import nn

from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.layers import conv_block, small_init


class Estimator(nn.Module):
    """(B,inputs,H,W) -> features (B,outputs,H,W) and a residual motion (B,2,H,W) in metres."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        """Build the stack; `outputs` tells how many feature channels leave it."""
        super().__init__()
        self.dense = config.dense
        self.layers = nn.ModuleList()
        for width in config.estimator_channels:
            self.layers.append(conv_block(inputs, width))
            inputs = inputs + width if self.dense else width
        self.outputs = inputs
        self.motion = small_init(nn.Conv2d(inputs, 2, 3, padding=1))

    def forward(self, evidence: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return (features, residual motion)."""
        for layer in self.layers:
            after = layer(evidence)
            evidence = torch.cat((after, evidence), dim=1) if self.dense else after
        return evidence, self.motion(evidence)


class Upsampler(nn.Module):
    """Motion and features of a level, at twice the resolution for the next one."""

    def __init__(self, config: NetworkConfig, *, inputs: int) -> None:
        """Start the motion's kernel as bilinear interpolation."""
        super().__init__()
        self.motion = nn.ConvTranspose2d(2, 2, 4, 2, 1, bias=False)
        self.features = nn.ConvTranspose2d(inputs, config.upfeat_channels, 4, 2, 1)
        ramp = torch.tensor([0.25, 0.75, 0.75, 0.25])
        with torch.no_grad():
            self.motion.weight.zero_()
            for axis in range(2):
                self.motion.weight[axis, axis] = torch.outer(ramp, ramp)

    def forward(
        self, motion: torch.Tensor, features: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return (motion, features), both (B,.,2H,2W)."""
        return self.motion(motion), self.features(features)
