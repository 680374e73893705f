"""An exponential moving average of the weights: smoother than any single step."""

from __future__ import annotations

import torch
from torch import nn


class WeightAverage:
    """Averages parameters and the statistics of the batch normalisation."""

    def __init__(self, network: nn.Module, decay: float) -> None:
        """Start from the present weights."""
        self.decay = decay
        self.state = {k: v.detach().clone() for k, v in network.state_dict().items()}

    @torch.no_grad()
    def update(self, network: nn.Module, step: int) -> None:
        """Move towards the weights after `step` (0, 1, ..); young averages move faster."""
        decay = min(self.decay, (1.0 + step) / (10.0 + step))
        for name, value in network.state_dict().items():
            mean = self.state[name]
            if mean.is_floating_point():
                mean.lerp_(value, 1.0 - decay)
            else:
                mean.copy_(value)
