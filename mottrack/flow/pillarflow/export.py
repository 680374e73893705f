"""ONNX export of everything behind the pillars, with a parity check in onnxruntime.

The graph takes two pseudo-images (1,C,H,W) and the visibility (1,4,H,W) and gives the displacement
and the factor of its covariance, of a fixed grid. The pillars stay outside: a scatter inside the
graph costs more than the fused loop. TensorRT, on an NVIDIA card, is not measured here:

    trtexec --onnx=model.onnx --saveEngine=model.plan --fp16
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import torch
from torch import nn

from mottrack.core.arrays import F32
from mottrack.core.errors import MottrackError
from mottrack.flow.pillarflow.engine import fold
from mottrack.flow.pillarflow.network import BevFlowNet
from mottrack.flow.pillarflow.pillars import CellGrid
from mottrack.flow.pillarflow.weights_file import Weights

INPUTS = ("current", "previous", "shares", "older", "ratio")
OUTPUTS = ("motion_m", "factor")
TOLERANCE_M = 1e-3
"""Far below the 2 cm noise of a LiDAR, far above what another order of float32 sums changes."""


class _FinestFlow(nn.Module):
    """The network with the finest displacement and its factor as its outputs."""

    def __init__(self, flow: BevFlowNet) -> None:
        super().__init__()
        self.flow = flow

    def forward(self, *inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        estimate = self.flow(*inputs)
        return estimate.motions[-1], estimate.factor


def random_inputs(weights: Weights, cells: CellGrid) -> tuple[torch.Tensor, ...]:
    """Return random `INPUTS`; one cell in twenty is occupied, as in a LiDAR sweep.

    A network without older sweeps has the first three alone.
    """
    generator = torch.Generator().manual_seed(0)
    config, size = weights.network.config, (cells.rows, cells.columns)
    images = []
    for _ in range(2 + config.older):
        image = torch.rand(1, config.image_channels, *size, generator=generator)
        images.append(image * (torch.rand(size, generator=generator) < 0.05))
    shares = torch.rand(1, 8, *size, generator=generator)
    if not config.older:
        return (*images, shares)
    ratio = torch.tensor([[0.1 / age_s for age_s in config.older_ages_s]])
    return (*images[:2], shares, torch.cat(images[2:], dim=1), ratio)


def export_onnx(weights: Weights, file: Path, cells: CellGrid) -> float:
    """Write the flow network for the grid `cells`; returns the largest difference in metres.

    Raises:
        MottrackError: onnxruntime's output differs by more than a millimetre.
    """
    module = _FinestFlow(fold(weights.network.flow)).eval()
    inputs = random_inputs(weights, cells)
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module,
            inputs,
            str(file),
            input_names=list(INPUTS[: len(inputs)]),
            output_names=list(OUTPUTS),
            opset_version=18,
            dynamo=False,
        )
        expected = [one.numpy() for one in module(*inputs)]
    worst_m = max(
        float(np.abs(a - b).max())
        for a, b in zip(expected, _onnxruntime(file, inputs), strict=True)
    )
    if not worst_m <= TOLERANCE_M:
        raise MottrackError(f"{file}: onnxruntime differs by {worst_m:.2g} m, expected < 1 mm")
    return worst_m


def _onnxruntime(file: Path, inputs: tuple[torch.Tensor, ...]) -> list[F32]:
    import onnxruntime

    session = onnxruntime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    values = dict(zip(INPUTS, (one.numpy() for one in inputs), strict=False))
    # a network without visibility has two inputs
    used = {one.name: values[one.name] for one in session.get_inputs()}
    results: list[F32] = session.run(list(OUTPUTS), used)
    return results
