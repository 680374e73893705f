"""How good a network is on held-out examples, in metres per second."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from mottrack.flow.pillarflow.descriptors import CellGrid
from mottrack.flow.pillarflow.network import PillarFlowNet
from mottrack.flow.pillarflow.training.batches import collate
from mottrack.flow.pillarflow.training.crop import CropConfig, whole
from mottrack.flow.pillarflow.training.example import Example
from mottrack.flow.pillarflow.training.losses import whitened
from mottrack.flow.pillarflow.training.targets import pooled_target

MOVING_MPS = 0.5
INSIDE_2_SIGMA = 1.0 - math.exp(-2.0)


@dataclass(frozen=True)
class Scores:
    """Errors over occupied cells; dynamic: the truth is faster than 0.5 m/s."""

    dynamic_rmse: float
    """m/s"""
    dynamic_median: float
    """m/s"""
    within_1_mps: float
    """Share of dynamic cells."""
    static_rmse: float
    """m/s"""
    static_over_1_mps: float
    """Share of static cells."""
    inside_1_sigma: float
    """Share of all cells; 0.393 if the covariance is right and the errors are normal."""
    inside_2_sigma: float
    """Share of all cells; 0.865 likewise."""

    def as_dict(self) -> dict[str, float]:
        """Plain numbers for a file."""
        return asdict(self)


@dataclass(frozen=True)
class CellErrors:
    """Per occupied and observable cell of the held-out examples."""

    error_mps: NDArray[np.float32]
    """(N,) length of the error."""
    speed_mps: NDArray[np.float32]
    """(N,) true speed."""
    mahalanobis2: NDArray[np.float32]
    """(N,) squared error in units of the head's scale."""

    def scores(self, covariance_scale: float = 1.0) -> Scores:
        """Summarise; `covariance_scale` multiplies the head's covariance."""
        moving = self.speed_mps > MOVING_MPS
        dynamic, static = self.error_mps[moving], self.error_mps[~moving]
        return Scores(
            dynamic_rmse=_rms(dynamic),
            dynamic_median=float(np.median(dynamic)) if len(dynamic) else 0.0,
            within_1_mps=_share(dynamic < 1.0),
            static_rmse=_rms(static),
            static_over_1_mps=_share(static > 1.0),
            inside_1_sigma=_share(self.mahalanobis2 < covariance_scale),
            inside_2_sigma=_share(self.mahalanobis2 < 4.0 * covariance_scale),
        )


@torch.no_grad()
def cell_errors(
    network: PillarFlowNet, examples: Sequence[Example], cells: CellGrid, crop: CropConfig
) -> CellErrors:
    """Run the network over the examples on the grid `cells`."""
    network.eval()
    device = next(network.parameters()).device
    rows = []
    for index in range(len(examples)):
        batch = collate([whole(examples[index], cells, crop)]).to(device)
        estimate = network(batch.pair)
        stride = cells.rows // estimate.motions[-1].shape[-2]
        truth, mask = pooled_target(batch.target.motion_m, batch.target.mask, stride)
        away = (estimate.motions[-1] - truth).norm(dim=1) / batch.target.elapsed_s
        speed = truth.norm(dim=1) / batch.target.elapsed_s
        square = whitened(estimate, truth).square().sum(1)
        rows.append(torch.stack((away, speed, square), 0)[:, mask[:, 0]].cpu().numpy())
    network.train()
    joined = np.concatenate(rows, axis=1)
    return CellErrors(joined[0], joined[1], joined[2])


def calibration(errors: CellErrors) -> float:
    """Factor on the head's covariance that puts 86.5 % of all errors inside two sigma.

    That is the share of a normal error in two dimensions. Errors of flow have heavier tails, so one
    factor cannot serve both contours: with this one the outer contour is right, which is where a
    tracker gates, and more than 39 % of the errors lie inside one sigma.
    """
    if not len(errors.mahalanobis2):
        return 1.0
    return max(float(np.quantile(errors.mahalanobis2, INSIDE_2_SIGMA)) / 4.0, 1e-6)


def _rms(values: NDArray[np.float32]) -> float:
    return float(np.sqrt(np.mean(values.astype(np.float64) ** 2))) if len(values) else 0.0


def _share(mask: NDArray[np.bool_]) -> float:
    return float(mask.mean()) if len(mask) else 0.0
