"""ONNX export of everything behind the pillars, with a parity check in onnxruntime.

The graph takes two pseudo-images (1,C,H,W) and the visibility (1,4,H,W) and gives the motion and
the factor of its covariance, of a fixed grid. The pillars stay outside: a scatter inside the graph
costs more than the fused loop. The next step on an NVIDIA card is TensorRT, not measured here:

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
from mottrack.flow.pillarflow.descriptors import CellGrid
from mottrack.flow.pillarflow.inference.fold import folded
from mottrack.flow.pillarflow.network import BevFlowNet
from mottrack.flow.pillarflow.weights_file import Weights

INPUTS = ("current", "previous", "visibility")
OUTPUTS = ("motion_m", "factor")
TOLERANCE_M = 1e-3


class _Finest(nn.Module):
    """The two tensors that leave the network."""

    def __init__(self, flow: BevFlowNet) -> None:
        super().__init__()
        self.flow = flow

    def forward(
        self, current: torch.Tensor, previous: torch.Tensor, visibility: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        estimate = self.flow(current, previous, visibility)
        return estimate.motions[-1], estimate.factor


def example_inputs(weights: Weights, cells: CellGrid) -> tuple[torch.Tensor, ...]:
    """Sparse random pseudo-images (1,C,H,W) twice and visibility (1,4,H,W)."""
    config = weights.network.config
    channels = config.pillar_channels if config.encoder == "pillars" else 1
    generator = torch.Generator().manual_seed(0)
    images = []
    for _ in range(2):
        image = torch.rand(1, channels, cells.rows, cells.columns, generator=generator)
        images.append(image * (torch.rand(image.shape[-2:], generator=generator) < 0.05))
    seen = torch.rand(1, 4, cells.rows, cells.columns, generator=generator)
    return (*images, seen)


def export_onnx(weights: Weights, file: Path, cells: CellGrid) -> float:
    """Write the flow network for the grid `cells`; returns the largest difference in metres.

    Raises:
        MottrackError: onnxruntime's answer differs by more than a millimetre.
    """
    module = _Finest(folded(weights.network.flow)).eval()
    inputs = example_inputs(weights, cells)
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module,
            inputs,
            str(file),
            input_names=list(INPUTS),
            output_names=list(OUTPUTS),
            opset_version=18,
            dynamo=False,
        )
        expected = [one.numpy() for one in module(*inputs)]
    worst = max(
        float(np.abs(mine - theirs).max())
        for mine, theirs in zip(expected, _onnxruntime(file, inputs), strict=True)
    )
    if not worst <= TOLERANCE_M:
        raise MottrackError(f"{file}: onnxruntime differs by {worst:.2g} m, expected < 1 mm")
    return worst


def _onnxruntime(file: Path, inputs: tuple[torch.Tensor, ...]) -> list[F32]:
    import onnxruntime

    session = onnxruntime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    fed = dict(zip(INPUTS, (one.numpy() for one in inputs), strict=True))
    wanted = {one.name for one in session.get_inputs()}
    results: list[F32] = session.run(
        list(OUTPUTS), {name: value for name, value in fed.items() if name in wanted}
    )
    return results
