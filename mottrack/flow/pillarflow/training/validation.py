"""Errors of a network on held-out examples, in metres per second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from mottrack.core.arrays import F32, Mask
from mottrack.core.motion import MOVING_MPS
from mottrack.flow.pillarflow.calibration import (
    Calibration,
    Residuals,
    covariance_of_factor,
    coverage,
)
from mottrack.flow.pillarflow.network import PillarFlowNet
from mottrack.flow.pillarflow.training.batches import (
    NO_ROTATION,
    collate,
    cut,
    without_older,
)
from mottrack.flow.pillarflow.training.config import CropConfig
from mottrack.flow.pillarflow.training.examples import EXAMPLE_GRID, Example


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


@dataclass(frozen=True)
class CellErrors:
    """Errors of N occupied and observable cells of the held-out examples."""

    error_mps: F32
    """(N,) length of the error."""
    speed_mps: F32
    """(N,) true speed."""
    residuals: Residuals
    """The same in metres over the interval, with the estimates."""

    def scores(self, calibration: Calibration | None = None) -> Scores:
        """Summarise, the coverage with the covariance calibrated."""
        one, two = coverage(self.residuals.mahalanobis2(calibration or Calibration()))
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
    network: PillarFlowNet,
    examples: Sequence[Example],
    crop: CropConfig,
    older: int | None = None,
) -> CellErrors:
    """Run the network over whole examples.

    Args:
        network: the network; it is in training mode afterwards.
        examples: with at least the older sweeps that it takes.
        crop: says which objects are observable.
        older: how many older sweeps are given; None: all.
    """
    network.eval()
    cells = network.cells(EXAMPLE_GRID)
    device = next(network.parameters()).device
    rows = []
    for example in examples:
        whole = cut(example, cells, NO_ROTATION, crop)
        batch = collate([whole if older is None else without_older(whole, older)]).to(device)
        estimate = network(batch.pair)
        motion, elapsed_s = estimate.motions[-1], batch.target.elapsed_s
        truth, mask = batch.target.pooled(cells.rows // motion.shape[-2])
        error = (motion - truth).norm(dim=1) / elapsed_s
        speed = truth.norm(dim=1) / elapsed_s
        columns = torch.cat((error[:, None], speed[:, None], motion, truth, estimate.factor), 1)
        rows.append(columns.permute(0, 2, 3, 1)[mask[:, 0]].cpu().numpy())
    network.train()
    table = np.concatenate(rows)
    motion_m, truth_m, factor = table[:, 2:4], table[:, 4:6], table[:, 6:]
    residuals = Residuals(motion_m - truth_m, motion_m, covariance_of_factor(factor))
    return CellErrors(table[:, 0], table[:, 1], residuals)


def _rms(values: F32) -> float:
    return float(np.sqrt(np.mean(values.astype(np.float64) ** 2))) if len(values) else 0.0


def _share(mask: Mask) -> float:
    return float(mask.mean()) if len(mask) else 0.0
