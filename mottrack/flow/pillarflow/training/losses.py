"""Training losses: the multi-scale L2 norm of the paper, its balanced variant, the head's NLL.

L = sum_l alpha_l sum_x |f_l(x) - f_gt_l(x)|_2 (paper, section III-C; alpha after Sun et al.). Most
cells of a BeV grid are empty and most occupied ones stand still, so the balanced variant takes
means over occupied cells in buckets of speed in place of the sum over all cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch.nn import functional

from mottrack.flow.pillarflow.network import Estimate
from mottrack.flow.pillarflow.training.config import LossConfig

PAPER_ALPHAS = (0.32, 0.08, 0.02, 0.01, 0.005)
"""Weights of the levels, coarse to fine, as published for PWC-Net."""
SHADOW_SHARE = 0.3
"""Above this share of its points a cell is at a shadow edge; chosen by eye."""
DEGREES_OF_FREEDOM = 3.0
"""Of the likelihood's Student t: the fewest whole ones with which a covariance exists."""


@dataclass(frozen=True)
class Target:
    """Truth of a batch on the pillars' grid."""

    motion_m: torch.Tensor
    """(B,2,H,W) displacement."""
    mask: torch.Tensor
    """(B,1,H,W) 1 where it counts."""
    elapsed_s: torch.Tensor
    """(B,)"""
    shadow: torch.Tensor
    """(B,1,H,W) share of a cell's points that the other sweep could not see or saw through."""

    def to(self, device: torch.device) -> Target:
        """Copy to a device."""
        parts = (self.motion_m, self.mask, self.elapsed_s, self.shadow)
        return Target(*(part.to(device, non_blocking=True) for part in parts))

    def pooled(self, stride: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Average over the counted cells in blocks of `stride`.

        Returns the displacement (B,2,H/stride,W/stride) and the mask (B,1,..) of the blocks that
        hold at least one counted cell.
        """
        if stride == 1:
            return self.motion_m, self.mask > 0
        share = functional.avg_pool2d(self.mask, stride)
        total = functional.avg_pool2d(self.motion_m * self.mask, stride)
        # the floor is far below the share of one cell in any block: it only avoids 0 / 0
        return total / share.clamp(min=1e-6), share > 0


def multi_scale_loss(estimate: Estimate, target: Target, config: LossConfig) -> torch.Tensor:
    """Return the loss of all levels plus the negative log-likelihood of the finest one."""
    count = len(estimate.motions)
    total = estimate.motions[0].new_zeros(())
    for index, motion in enumerate(estimate.motions):
        stride = target.motion_m.shape[-1] // motion.shape[-1]
        truth, mask = target.pooled(stride)
        if config.kind == "paper":
            alpha = PAPER_ALPHAS[min(index, len(PAPER_ALPHAS) - 1)]
            total = total + alpha * _norm(motion - truth).sum() / motion.shape[0]
        else:
            speed = _norm(truth) / target.elapsed_s[:, None, None]
            weight = config.level_decay ** (count - 1 - index)
            total = total + weight * bucket_mean(_norm(motion - truth), speed, mask[:, 0], config)
            total = total + weight * config.empty_weight * empty_mean(motion, mask[:, 0])
            if config.shadow_weight:
                edge = functional.max_pool2d(target.shadow, stride)[:, 0] > SHADOW_SHARE
                at_rest = mask[:, 0] & edge & (speed <= config.speed_edges_mps[0])
                error = masked_mean(_norm(motion - truth), at_rest)
                total = total + weight * config.shadow_weight * error
    likelihood = negative_log_likelihood(estimate, truth, mask[:, 0])
    return total + config.nll_weight * likelihood


def bucket_mean(
    error: torch.Tensor, speed: torch.Tensor, mask: torch.Tensor, config: LossConfig
) -> torch.Tensor:
    """Sum the mean `error` (B,H,W) of the cells of each bucket of `speed` [m/s]."""
    edges = (-1.0, *config.speed_edges_mps, float("inf"))
    total = error.new_zeros(())
    for index, (low, high) in enumerate(pairwise(edges)):
        inside = (mask & (speed > low) & (speed <= high)).to(error.dtype)
        weight = config.static_weight if index == 0 else 1.0
        total = total + weight * (error * inside).sum() / inside.sum().clamp(min=1.0)
    return total


def masked_mean(values: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the mean of the values (B,H,W) inside of the mask (B,H,W); 0 where it is empty."""
    inside = mask.to(values.dtype)
    return (values * inside).sum() / inside.sum().clamp(min=1.0)


def empty_mean(motion: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the mean length of the displacements (B,2,H,W) outside of the mask (B,H,W)."""
    return masked_mean(_norm(motion), ~mask)


def whitened(estimate: Estimate, truth: torch.Tensor) -> torch.Tensor:
    """Return L^-1 (f_gt - f) of the finest level (B,2,H,W); no gradient flows to the motion."""
    error = truth - estimate.motions[-1].detach()
    xx, yx, yy = (estimate.factor[:, i : i + 1] for i in range(3))
    x = error[:, :1] * torch.exp(-xx)
    y = (error[:, 1:] - yx * x) * torch.exp(-yy)
    return torch.cat((x, y), dim=1)


def negative_log_likelihood(
    estimate: Estimate, truth: torch.Tensor, mask: torch.Tensor
) -> torch.Tensor:
    """Return -log p of a two-dimensional Student t, up to a constant, as a mean over the mask.

    Errors of flow have heavy tails (a wrong match is metres off); the t keeps them from widening
    the bulk. `calibration` turns its scale into a covariance.
    """
    square = whitened(estimate, truth).square().sum(dim=1)
    scale = estimate.factor[:, 0] + estimate.factor[:, 2]
    # log |L| + (nu + d) / 2 log(1 + r^2 / nu), d = 2
    exponent = (DEGREES_OF_FREEDOM + 2.0) / 2.0
    value = scale + exponent * torch.log1p(square / DEGREES_OF_FREEDOM)
    weight = mask.to(value.dtype)
    return (value * weight).sum() / weight.sum().clamp(min=1.0)


def _norm(vector: torch.Tensor) -> torch.Tensor:
    # the summand keeps the gradient finite at zero; it is (0.1 mm)^2
    return (vector.square().sum(dim=1) + 1e-8).sqrt()
