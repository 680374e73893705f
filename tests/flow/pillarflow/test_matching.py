"""Warping and the cost volume against plain definitions, and the threads of its kernels."""

from __future__ import annotations

import subprocess
import sys

import pytest
import torch
from pydantic import ValidationError

from mottrack.core.errors import InputError
from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.cost_volume import cost_volume, cost_volume_by_shifts
from mottrack.flow.pillarflow.layers import warp
from mottrack.flow.pillarflow.network import PillarFlowNet

SCRIPT = """
import numba, torch
from mottrack.flow.pillarflow.cost_volume import cost_volume
from mottrack.flow.pillarflow.engine import use_threads
use_threads({count})
before = torch.get_num_threads()
cost_volume(torch.ones(1, 4, 8, 8), torch.ones(1, 4, 8, 8), 1)
print(before, torch.get_num_threads())
"""


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


def test_kernel_and_shifts_agree_in_value_and_gradient() -> None:
    one, two = _maps(2, 2, 16, 12, 10), _maps(3, 2, 16, 12, 10)
    slope = _maps(4, 2, 49, 12, 10)
    results = []
    for method in (cost_volume, cost_volume_by_shifts):
        a, b = one.clone().requires_grad_(), two.clone().requires_grad_()
        costs = method(a, b, 3)
        costs.backward(slope)
        results.append((costs.detach(), a.grad, b.grad))
    for one_result, other in zip(*results, strict=True):
        assert torch.allclose(one_result, other, atol=1e-5)


def test_warp_samples_the_previous_place_of_a_cell() -> None:
    features = _maps(5, 1, 3, 8, 8)
    motion = torch.zeros(1, 2, 8, 8)
    motion[:, 0], motion[:, 1] = 2.0, -1.0
    warped = warp(features, motion)
    assert torch.allclose(warped[..., 0:7, 2:8], features[..., 1:8, 0:6], atol=1e-5)
    assert not warped[..., :, 0:2].any()


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


def test_an_unknown_backbone_is_refused() -> None:
    with pytest.raises(InputError, match=r"backbone is raft, expected one of pwc, spynet"):
        PillarFlowNet(NetworkConfig(backbone="raft"))


def test_starting_numbas_threads_leaves_torch_alone() -> None:
    script = SCRIPT.format(count=3)
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["3", "3"]
