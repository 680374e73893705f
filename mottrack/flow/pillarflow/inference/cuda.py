"""The same on a GPU: half precision and one CUDA graph for everything behind the pillars."""

from __future__ import annotations

import torch

from mottrack.core.arrays import F32
from mottrack.flow.pillarflow.descriptors import CellGrid, describe
from mottrack.flow.pillarflow.inference.engine import Motion, as_motion
from mottrack.flow.pillarflow.inference.fold import folded
from mottrack.flow.pillarflow.layers import channels_last
from mottrack.flow.pillarflow.network import Estimate
from mottrack.flow.pillarflow.pillar_net import Points
from mottrack.flow.pillarflow.weights_file import Weights

WARM_UP = 3


class CudaEngine:
    """Pillars eagerly (their number changes), the flow network as a captured graph."""

    def __init__(self, weights: Weights) -> None:
        """Move the folded network to the GPU in half precision."""
        config = weights.network.config
        self.stride, self.calibration = config.output_stride, weights.calibration
        self.encoder = weights.network.encoder.cuda().eval()
        self.flow = channels_last(folded(weights.network.flow).cuda())
        self.graphs: dict[tuple[int, ...], _Captured] = {}

    @torch.inference_mode()
    def run(self, previous: F32, current: F32, seen: F32, cells: CellGrid) -> Motion:
        """Points (N,4) of both sweeps and seen (4,rows,columns) -> motion."""
        images = [self.encoder(_points(points, cells)) for points in (current, previous)]
        inputs = (*images, torch.from_numpy(seen)[None].cuda())
        shape = tuple(images[0].shape)
        if shape not in self.graphs:
            self.graphs[shape] = _Captured(self.flow, inputs)
        return as_motion(self.graphs[shape].replay(inputs), self.stride, self.calibration)


class _Captured:
    """A forward pass recorded once for fixed shapes and replayed."""

    def __init__(self, flow: torch.nn.Module, inputs: tuple[torch.Tensor, ...]) -> None:
        self.inputs = tuple(one.clone() for one in inputs)
        self.graph = torch.cuda.CUDAGraph()
        stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            for _ in range(WARM_UP):
                self._forward(flow)
        torch.cuda.current_stream().wait_stream(stream)
        with torch.cuda.graph(self.graph):
            self.estimate = self._forward(flow)

    def _forward(self, flow: torch.nn.Module) -> Estimate:
        with torch.autocast("cuda", torch.float16, cache_enabled=False):
            estimate: Estimate = flow(*self.inputs)
        return estimate

    def replay(self, inputs: tuple[torch.Tensor, ...]) -> Estimate:
        for held, fresh in zip(self.inputs, inputs, strict=True):
            held.copy_(fresh)
        self.graph.replay()
        return self.estimate


def _points(points: F32, cells: CellGrid) -> Points:
    described, flat, _ = describe(points, cells)
    shape = (1, cells.rows, cells.columns)
    return Points(torch.from_numpy(described).cuda(), torch.from_numpy(flat).cuda(), shape)
