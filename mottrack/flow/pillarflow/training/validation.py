"""How good a network is on held-out examples, in metres per second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import torch

from mottrack.core.arrays import F32, Mask
from mottrack.flow.pillarflow.calibration import Calibration, Residuals, inside
from mottrack.flow.pillarflow.descriptors import CellGrid
from mottrack.flow.pillarflow.inference.engine import covariance_of
from mottrack.flow.pillarflow.network import PillarFlowNet
from mottrack.flow.pillarflow.training.batches import collate
from mottrack.flow.pillarflow.training.crop import CropConfig, whole
from mottrack.flow.pillarflow.training.example import Example
from mottrack.flow.pillarflow.training.targets import pooled_target

MOVING_MPS = 0.5


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

    error_mps: F32
    """(N,) length of the error."""
    speed_mps: F32
    """(N,) true speed."""
    residuals: Residuals
    """The same in metres over the interval, with what the network said."""

    def scores(self, calibration: Calibration | None = None) -> Scores:
        """Summarise, with the covariance calibrated."""
        one, two = inside(self.residuals.mahalanobis2(calibration or Calibration()))
        moving = self.speed_mps > MOVING_MPS
        dynamic, static = self.error_mps[moving], self.error_mps[~moving]
        return Scores(
            dynamic_rmse=_rms(dynamic),
            dynamic_median=float(np.median(dynamic)) if len(dynamic) else 0.0,
            within_1_mps=_share(dynamic < 1.0),
            static_rmse=_rms(static),
            static_over_1_mps=_share(static > 1.0),
            inside_1_sigma=one,
            inside_2_sigma=two,
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
        motion = estimate.motions[-1]
        columns = torch.cat((away[:, None], speed[:, None], motion, truth, estimate.factor), 1)
        rows.append(columns.permute(0, 2, 3, 1)[mask[:, 0]].cpu().numpy())
    network.train()
    return _gathered(np.concatenate(rows))


def _gathered(cells: F32) -> CellErrors:
    """From rows (N,9): error and speed in m/s, claimed and true motion, the head's factor."""
    motion_m, truth_m = cells[:, 2:4], cells[:, 4:6]
    residuals = Residuals(motion_m - truth_m, motion_m, covariance_of(cells[:, 6:]))
    return CellErrors(cells[:, 0], cells[:, 1], residuals)


def _rms(values: F32) -> float:
    return float(np.sqrt(np.mean(values.astype(np.float64) ** 2))) if len(values) else 0.0


def _share(mask: Mask) -> float:
    return float(mask.mean()) if len(mask) else 0.0
