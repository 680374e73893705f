"""Warping and the cost volume against plain definitions."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.cost_volume import cost_volume, cost_volume_by_shifts
from mottrack.flow.pillarflow.presets import PRESETS
from mottrack.flow.pillarflow.pyramid import Pyramid
from mottrack.flow.pillarflow.reach import (
    check_reach,
    pyramid_field_cells,
    reach_m,
    receptive_field_m,
)
from mottrack.flow.pillarflow.warping import warp


def _maps(seed: int, *shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def test_cost_volume_is_the_mean_product_at_every_shift() -> None:
    one, two = _maps(0, 2, 5, 7, 9), _maps(1, 2, 5, 7, 9)
    costs = cost_volume(one, two, 2)
    for row, column in ((0, 0), (3, 4), (6, 8)):
        for s in range(25):
            v, u = row + s // 5 - 2, column + s % 5 - 2
            inside = 0 <= v < 7 and 0 <= u < 9
            wanted = (one[1, :, row, column] * two[1, :, v, u]).mean() if inside else 0.0
            assert float(costs[1, s, row, column]) == pytest.approx(float(wanted), abs=1e-6)


def test_kernel_and_shifts_agree_forward_and_backward() -> None:
    one, two = _maps(2, 2, 16, 12, 10), _maps(3, 2, 16, 12, 10)
    slope = _maps(4, 2, 49, 12, 10)
    results = []
    for method in (cost_volume, cost_volume_by_shifts):
        a, b = one.clone().requires_grad_(), two.clone().requires_grad_()
        costs = method(a, b, 3)
        costs.backward(slope)
        results.append((costs.detach(), a.grad, b.grad))
    for mine, theirs in zip(*results, strict=True):
        assert torch.allclose(mine, theirs, atol=1e-5)


def test_warp_fetches_from_where_the_cell_came() -> None:
    features = _maps(5, 1, 3, 8, 8)
    motion = torch.zeros(1, 2, 8, 8)
    motion[:, 0], motion[:, 1] = 2.0, -1.0
    warped = warp(features, motion)
    assert torch.allclose(warped[..., 0:7, 2:8], features[..., 1:8, 0:6], atol=1e-5)
    assert not warped[..., :, 0:2].any()


@pytest.mark.parametrize("name", ["small", "base", "paper", "binary_ogm", "spynet", "flownet"])
def test_35_mps_at_10_hz_is_within_reach(name: str) -> None:
    check_reach(PRESETS[name], speed_mps=35.0, elapsed_s=0.1)
    assert reach_m(PRESETS[name]) >= 3.5
    assert receptive_field_m(PRESETS[name]) > 2 * 3.5


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"context_dilations": (1, 2)}, "context_dilations has 2 numbers, expected 3"),
        ({"finest_level": 3}, "finest_level is 3, expected less than 3"),
    ],
)
def test_a_network_that_does_not_fit_together_is_refused(
    settings: dict[str, object], words: str
) -> None:
    with pytest.raises(ValidationError, match=words):
        NetworkConfig(**settings)


def test_receptive_field_is_what_the_gradient_says() -> None:
    """An input outside of the stated field must not change the middle of the output."""
    config = NetworkConfig(pyramid_channels=(4, 4, 4), visibility=False)
    torch.manual_seed(0)
    pyramid = Pyramid(config, inputs=1).eval()
    image = torch.zeros(1, 1, 96, 96, requires_grad=True)
    coarse = pyramid(image)[-1]
    coarse[..., 12, 12].sum().backward()
    seen = np.flatnonzero(image.grad[0, 0].abs().sum(0).numpy())
    assert np.ptp(seen) + 1 == pyramid_field_cells(config)
