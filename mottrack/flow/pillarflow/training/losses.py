"""Training losses: the multi-scale L2 norm of the paper, its balanced variant, the head's NLL.

L = sum_l alpha_l sum_x |f_l(x) - f_gt_l(x)|_2 (paper, section III-C; alpha after Sun et al.). Most
cells of a BeV grid are empty and most occupied ones stand still, so the balanced variant takes
means over occupied cells in buckets of speed in place of the sum over all cells.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import torch
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.flow.pillarflow.network import Estimate
from mottrack.flow.pillarflow.training.targets import pooled_target

PAPER_ALPHAS = (0.32, 0.08, 0.02, 0.01, 0.005)


class LossConfig(StrictModel):
    """Which loss, and its weights."""

    kind: Literal["balanced", "paper"] = Field("balanced", description="see the module")
    level_decay: float = Field(0.5, gt=0, le=1, description="weight of a level / next finer one")
    speed_edges_mps: tuple[float, ...] = Field((0.5, 3.0, 8.0), description="edges of the buckets")
    static_weight: float = Field(1.5, gt=0, description="weight of the slowest bucket")
    empty_weight: float = Field(
        0.1,
        ge=0,
        description="pull of empty cells to rest; left alone they grow without bound"
        " and take over the statistics of the batch normalisation",
    )
    nll_weight: float = Field(0.1, ge=0, description="weight of the uncertainty head's loss")


class Target:
    """Truth of a batch on the pillars' grid."""

    def __init__(self, motion_m: torch.Tensor, mask: torch.Tensor, elapsed_s: torch.Tensor) -> None:
        """`motion_m` (B,2,H,W), `mask` (B,1,H,W) 1 where it counts, `elapsed_s` (B,)."""
        self.motion_m, self.mask, self.elapsed_s = motion_m, mask, elapsed_s

    def to(self, device: torch.device) -> Target:
        """Copy to a device."""
        parts = (self.motion_m, self.mask, self.elapsed_s)
        return Target(*(part.to(device, non_blocking=True) for part in parts))


def multi_scale_loss(estimate: Estimate, target: Target, config: LossConfig) -> torch.Tensor:
    """Loss of all levels, plus the negative log likelihood of the finest one."""
    count = len(estimate.motions)
    total = estimate.motions[0].new_zeros(())
    for index, motion in enumerate(estimate.motions):
        stride = target.motion_m.shape[-1] // motion.shape[-1]
        truth, mask = pooled_target(target.motion_m, target.mask, stride)
        if config.kind == "paper":
            alpha = PAPER_ALPHAS[min(index, len(PAPER_ALPHAS) - 1)]
            total = total + alpha * _norm(motion - truth).sum() / motion.shape[0]
        else:
            speed = _norm(truth) / target.elapsed_s[:, None, None]
            weight = config.level_decay ** (count - 1 - index)
            total = total + weight * bucket_mean(_norm(motion - truth), speed, mask[:, 0], config)
            total = total + weight * config.empty_weight * empty_mean(motion, mask[:, 0])
    likelihood = negative_log_likelihood(estimate, truth, mask[:, 0])
    return total + config.nll_weight * likelihood


def bucket_mean(
    error: torch.Tensor, speed: torch.Tensor, mask: torch.Tensor, config: LossConfig
) -> torch.Tensor:
    """Sum over the buckets of speed of the mean `error` (B,H,W) of their cells."""
    edges = (-1.0, *config.speed_edges_mps, float("inf"))
    total = error.new_zeros(())
    for index, (low, high) in enumerate(pairwise(edges)):
        inside = (mask & (speed > low) & (speed <= high)).to(error.dtype)
        weight = config.static_weight if index == 0 else 1.0
        total = total + weight * (error * inside).sum() / inside.sum().clamp(min=1.0)
    return total


def empty_mean(motion: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Mean length of the motion (B,2,H,W) of the cells outside of the mask (B,H,W)."""
    empty = (~mask).to(motion.dtype)
    return (_norm(motion) * empty).sum() / empty.sum().clamp(min=1.0)


def whitened(estimate: Estimate, truth: torch.Tensor) -> torch.Tensor:
    """L^-1 (f_gt - f) of the finest level, (B,2,H,W); the motion is not trained through it."""
    error = truth - estimate.motions[-1].detach()
    first, cross, second = (estimate.factor[:, i : i + 1] for i in range(3))
    along = error[:, :1] * torch.exp(-first)
    across = (error[:, 1:] - cross * along) * torch.exp(-second)
    return torch.cat((along, across), dim=1)


def negative_log_likelihood(
    estimate: Estimate, truth: torch.Tensor, mask: torch.Tensor
) -> torch.Tensor:
    """-log p of a two-dimensional Student t with 3 degrees of freedom, mean over the mask.

    Errors of flow have heavy tails (a wrong match is metres off); the t keeps them from widening
    the bulk. `calibration` turns its scale into a covariance.
    """
    square = whitened(estimate, truth).square().sum(dim=1)
    scale = estimate.factor[:, 0] + estimate.factor[:, 2]
    value = scale + 2.5 * torch.log1p(square / 3.0)
    weight = mask.to(value.dtype)
    return (value * weight).sum() / weight.sum().clamp(min=1.0)


def _norm(vector: torch.Tensor) -> torch.Tensor:
    return (vector.square().sum(dim=1) + 1e-8).sqrt()
