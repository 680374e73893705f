"""Every network finds the largest motion that is expected (paper, section III-B).

"We adjust architecture parameters such as receptive field and correlation layer parameters to
account for the maximum relative motion that would be expected": 35 m/s at 10 Hz is 3.5 m between
two sweeps once ego motion is removed, 7 cells of 0.5 m. A cost volume of radius d at a level of
stride s covers d * s cells, and the levels add up, since each starts from the one before.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.decoders import PRESETS
from mottrack.flow.pillarflow.layers import Pyramid
from mottrack.flow.pillarflow.source import SHIPPED
from mottrack.flow.pillarflow.weights_file import load_weights

MAX_MOTION_M = 35.0 * 0.1
KERNEL_RADIUS = 3
"""A 7x7 kernel of SpyNet covers three cells to each side of the warped image."""


def _search_range_m(config: NetworkConfig) -> float:
    """Largest motion along an axis that the matching can find."""
    if config.backbone == "spynet":
        return config.cell_m * KERNEL_RADIUS * sum(config.strides)
    if config.backbone == "flownet":
        return config.cell_m * 3 * config.strides[2]
    return config.cell_m * config.displacement * sum(config.strides[config.finest_level :])


def _pyramid_field_cells(config: NetworkConfig) -> int:
    """Edge of the square of pillars that one coarsest feature depends on."""
    field, step = 1, 1
    for level in range(config.levels):
        field += 2 * step
        step *= config.stem_stride if level == 0 else 2
        field += 2 * step * (config.convs_per_level - 1)
    return field


def _receptive_field_m(config: NetworkConfig) -> float:
    """Edge of the square of ground that one coarsest feature depends on."""
    if config.backbone == "spynet":  # five 7x7 convolutions on the pooled image
        return config.cell_m * config.strides[-1] * (1 + 5 * 2 * KERNEL_RADIUS)
    return config.cell_m * _pyramid_field_cells(config)


@pytest.mark.parametrize("name", PRESETS)
def test_35_mps_at_10_hz_is_within_range(name: str) -> None:
    assert _search_range_m(PRESETS[name]) >= MAX_MOTION_M
    assert _receptive_field_m(PRESETS[name]) > 2 * MAX_MOTION_M


@pytest.mark.parametrize("file", sorted(SHIPPED.glob("*.safetensors")), ids=lambda file: file.stem)
def test_shipped_weights_have_the_range_too(file: Path) -> None:
    config = load_weights(file).network.config
    assert _search_range_m(config) >= MAX_MOTION_M
    assert _receptive_field_m(config) > 2 * MAX_MOTION_M


def test_receptive_field_is_that_of_the_gradient() -> None:
    """An input outside of the stated field does not change the middle of the output."""
    config = NetworkConfig(pyramid_channels=(4, 4, 4), visibility=False)
    torch.manual_seed(0)
    pyramid = Pyramid(config, inputs=1).eval()
    image = torch.zeros(1, 1, 96, 96, requires_grad=True)
    coarse = pyramid(image)[-1]
    coarse[..., 12, 12].sum().backward()
    seen = np.flatnonzero(image.grad[0, 0].abs().sum(0).numpy())
    assert np.ptp(seen) + 1 == _pyramid_field_cells(config)
