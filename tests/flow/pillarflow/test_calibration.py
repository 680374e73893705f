"""The calibrated covariance covers its share of the errors, at rest and in motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from mottrack.flow.pillarflow.calibration import (
    INSIDE_1_SIGMA,
    INSIDE_2_SIGMA,
    Calibration,
    Residuals,
    coverage,
    fit_calibration,
)
from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.network import PillarFlowNet
from mottrack.flow.pillarflow.weights_file import Weights, load_weights, save_weights

TRUE = Calibration(0.25, 0.12, 0.08)


def _cells(seed: int, count: int = 6000) -> Residuals:
    """Two cells in three rest; the errors are normal with the true covariance."""
    rng = np.random.default_rng(seed)
    motion_m = rng.uniform(-1.5, 1.5, (count, 2)) * (rng.random((count, 1)) < 1 / 3)
    head_m2 = rng.uniform(0.001, 0.01, count)[:, None, None] * np.eye(2)
    roots = np.linalg.cholesky(TRUE.covariance_m2(head_m2, motion_m).astype(np.float64))
    error_m = (roots @ rng.normal(size=(count, 2, 1)))[..., 0]
    return Residuals(*(a.astype(np.float32) for a in (error_m, motion_m, head_m2)))


def test_coverage_is_right_for_resting_and_for_moving_cells() -> None:
    fitted, others = fit_calibration(_cells(0)), _cells(1)
    moving = np.hypot(*others.motion_m.T) > 0
    for chosen in (moving, ~moving):
        one, two = coverage(others.select(chosen).mahalanobis2(fitted))
        assert abs(one - INSIDE_1_SIGMA) < 0.05
        assert abs(two - INSIDE_2_SIGMA) < 0.03
    plain = coverage(others.select(moving).mahalanobis2(Calibration(TRUE.scale)))
    assert plain[1] < 0.5


def test_no_cells_or_no_motion_still_give_a_calibration() -> None:
    nothing = _cells(0).select(np.zeros(0, np.int64))
    assert fit_calibration(nothing) == Calibration()
    resting = _cells(0)
    resting = resting.select(np.hypot(*resting.motion_m.T) == 0)
    assert fit_calibration(resting).sigma_m == 0.0


def test_the_weights_file_stores_the_calibration(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = PillarFlowNet(NetworkConfig(pillar_channels=4, pyramid_channels=(4, 4, 4)))
    save_weights(tmp_path / "a.safetensors", Weights(network, TRUE, True))
    assert load_weights(tmp_path / "a.safetensors").calibration == TRUE
