"""The interface of the flow networks behind the encoder, and what they get of older sweeps."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import torch
from torch import nn


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
