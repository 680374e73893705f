"""Inference on a CPU or a GPU: numpy points in, displacements and covariances out.

Batch normalisation is folded into the layers before it. On a CPU the pillars are one numba pass and
the convolutions run channels-last; on a GPU everything behind the pillars is one CUDA graph in half
precision.
"""

from __future__ import annotations

import copy
import ctypes
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, Protocol

import numba
import numpy as np
import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from mottrack.core.arrays import F32
from mottrack.core.errors import ConfigError
from mottrack.flow.pillarflow.calibration import Calibration, covariance_of_factor
from mottrack.flow.pillarflow.layers import Module, channels_last
from mottrack.flow.pillarflow.network import Estimate, PillarEncoder, PointBatch
from mottrack.flow.pillarflow.pillars import CellGrid, binary_image, describe, pillar_image
from mottrack.flow.pillarflow.weights_file import Weights

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
"""Of glibc's malloc.h."""
LARGEST_KEPT_BYTES = 1 << 25
"""32 MB, the most that glibc takes; the largest feature map of `base` has 18."""
KEPT_BYTES = 1 << 28
"""256 MB: a pass of `base` needs less at once."""


@dataclass(frozen=True)
class CellMotion:
    """Network output on its own grid, in metres over the interval between the sweeps."""

    motion_m: F32
    """(rows,columns,2) displacement of each cell since the previous sweep."""
    covariance_m2: F32
    """(rows,columns,2,2) covariance of its error."""
    stride: int
    """Edge of one of these cells in pillars."""


@dataclass(frozen=True)
class EngineInput:
    """The sweeps of a pair and what is known of their cells."""

    current: F32
    """(M,4) points of `pillars.network_points`, in the current ego frame."""
    previous: F32
    """(N,4) the same of the previous sweep."""
    shares: F32
    """(8,rows,columns) as in `network.NetworkInput`."""
    older: tuple[OlderPoints, ...] = ()
    """One for each of the network's older sweeps; empty: there are none."""


class OlderPoints(NamedTuple):
    """An older sweep."""

    points: F32
    """(P,4) as `EngineInput.previous`."""
    ratio: float
    """Time between the sweeps of the pair / age of this one; 0: there is none."""


class Engine(Protocol):
    """Runs one network on one device."""

    def run(self, given: EngineInput, cells: CellGrid) -> CellMotion:
        """Estimate the displacement of each of the network's cells."""
        ...


def make_engine(weights: Weights, *, device: str, precision: str) -> Engine:
    """Build the engine for a device ("auto", "cpu", "cuda") and precision ("auto", "fp32", "bf16").

    Raises:
        ConfigError: a GPU is asked for and there is none.
    """
    available = torch.cuda.is_available()
    if device == "cuda" and not available:
        raise ConfigError("flow.device is cuda, expected cpu or auto: torch finds no GPU")
    if available and device != "cpu":
        return CudaEngine(weights)
    half = precision == "bf16" or (precision == "auto" and has_bf16_units())
    return CpuEngine(weights, half=half)


class CpuEngine:
    """Folded weights, channels-last convolutions, numba pillars and cost volumes."""

    def __init__(self, weights: Weights, *, half: bool = False) -> None:
        """Fold the weights; `half` runs convolutions in bfloat16 (matching stays in float32)."""
        keep_freed_memory()
        self.half = half
        self.stride = weights.network.config.output_stride
        self.calibration = weights.calibration
        self.flow = channels_last(fold(weights.network.flow))
        encoder = weights.network.encoder
        self.layer: tuple[F32, F32] | None = None
        if isinstance(encoder, PillarEncoder):
            weight, bias = fold_linear(encoder)
            self.layer = weight.numpy(), bias.numpy()

    def image(self, points: F32, cells: CellGrid) -> F32:
        """Return the pseudo-image (rows,columns,C) of one sweep."""
        if self.layer is None:
            return binary_image(points, cells)
        return pillar_image(points, cells, *self.layer)

    def run(self, given: EngineInput, cells: CellGrid) -> CellMotion:
        """Estimate the displacement of each cell, see `Engine`."""
        return self.flow_of(*self.tensors(given, cells))

    def tensors(self, given: EngineInput, cells: CellGrid) -> list[torch.Tensor]:
        """Return the inputs of the flow network (see `BevFlowNet`), of batches of one.

        Pseudo-images are channels last and made in parallel (the loops release the GIL).
        """
        sweeps = [given.current, given.previous, *(one.points for one in given.older)]
        with ThreadPoolExecutor(min(len(sweeps), torch.get_num_threads())) as pool:
            made = list(pool.map(lambda points: self.image(points, cells), sweeps))
        current, previous, *older = (
            torch.from_numpy(image)[None].permute(0, 3, 1, 2) for image in made
        )
        inputs = [current, previous, torch.from_numpy(given.shares)[None]]
        if older:
            inputs += [torch.cat(older, dim=1), _ratios(given)]
        return inputs

    @torch.inference_mode()
    def flow_of(self, *inputs: torch.Tensor) -> CellMotion:
        """Estimate from the inputs of `tensors`."""
        with torch.autocast("cpu", torch.bfloat16, enabled=self.half):
            estimate = self.flow(*inputs)
        return _first_motion(estimate, self.stride, self.calibration)


class CudaEngine:
    """Pillars eagerly (their number changes), the flow network as a captured graph."""

    def __init__(self, weights: Weights) -> None:
        """Move the folded network to the GPU."""
        self.stride = weights.network.config.output_stride
        self.calibration = weights.calibration
        self.encoder = weights.network.encoder.cuda().eval()
        self.flow = channels_last(fold(weights.network.flow).cuda())
        self.graphs: dict[tuple[int, ...], _CapturedGraph] = {}

    @torch.inference_mode()
    def run(self, given: EngineInput, cells: CellGrid) -> CellMotion:
        """Estimate the displacement of each cell, see `Engine`."""
        current, previous, *older = (
            self._image(points, cells)
            for points in (given.current, given.previous, *(one.points for one in given.older))
        )
        inputs = [current, previous, torch.from_numpy(given.shares)[None].cuda()]
        if older:
            inputs += [torch.cat(older, dim=1), _ratios(given).cuda()]
        shape = (*current.shape, len(older))
        if shape not in self.graphs:
            self.graphs[shape] = _CapturedGraph(self.flow, tuple(inputs))
        motion = self.graphs[shape].replay(tuple(inputs))
        return _first_motion(motion, self.stride, self.calibration)

    def _image(self, points: F32, cells: CellGrid) -> torch.Tensor:
        described = describe(points, cells)
        batch = PointBatch(
            torch.from_numpy(described.descriptors).cuda(),
            torch.from_numpy(described.cells).cuda(),
            sweeps=1,
            rows=cells.rows,
            columns=cells.columns,
        )
        image: torch.Tensor = self.encoder(batch)
        return image


class _CapturedGraph:
    """A forward pass in half precision, recorded once for fixed shapes and replayed."""

    warm_up = 3
    """Passes before the capture, in which cuDNN chooses its kernels; as in torch's own example."""

    def __init__(self, flow: nn.Module, inputs: tuple[torch.Tensor, ...]) -> None:
        self.inputs = tuple(one.clone() for one in inputs)
        self.graph = torch.cuda.CUDAGraph()
        stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            for _ in range(self.warm_up):
                self._forward(flow)
        torch.cuda.current_stream().wait_stream(stream)
        with torch.cuda.graph(self.graph):
            self.estimate = self._forward(flow)

    def _forward(self, flow: nn.Module) -> Estimate:
        # a cache of casted weights would be filled inside the graph and freed behind its back
        with torch.autocast("cuda", torch.float16, cache_enabled=False):
            estimate: Estimate = flow(*self.inputs)
        return estimate

    def replay(self, inputs: tuple[torch.Tensor, ...]) -> Estimate:
        """Run the graph on new inputs of the same shapes."""
        for fixed, new in zip(self.inputs, inputs, strict=True):
            fixed.copy_(new)
        self.graph.replay()
        return self.estimate


def _ratios(given: EngineInput) -> torch.Tensor:
    return torch.tensor([[one.ratio for one in given.older]], dtype=torch.float32)


def _first_motion(estimate: Estimate, stride: int, calibration: Calibration) -> CellMotion:
    """Return the first pair of a batch as arrays, its covariance calibrated."""
    motion_m, factor = (
        one[0].permute(1, 2, 0).float().cpu().numpy()
        for one in (estimate.motions[-1], estimate.factor)
    )
    covariance_m2 = calibration.covariance_m2(covariance_of_factor(factor), motion_m)
    return CellMotion(np.ascontiguousarray(motion_m), covariance_m2, stride)


def fold(module: Module) -> Module:
    """Return a copy in evaluation mode with batch normalisation folded into the convolutions."""
    module = copy.deepcopy(module).eval()
    for part in module.modules():
        if isinstance(part, nn.Sequential):
            _fold_sequence(part)
    return module


def _fold_sequence(sequence: nn.Sequential) -> None:
    for index, (first, second) in enumerate(pairwise(list(sequence))):
        if isinstance(first, nn.Conv2d) and isinstance(second, nn.BatchNorm2d):
            sequence[index] = fuse_conv_bn_eval(first, second)
            sequence[index + 1] = nn.Identity()


def fold_linear(encoder: PillarEncoder) -> tuple[torch.Tensor, torch.Tensor]:
    """Return weight (C,9) and bias (C,) of the encoder's layer with its normalisation folded in."""
    norm = encoder.norm
    if norm.running_var is None or norm.running_mean is None:
        raise TypeError("the encoder's normalisation keeps no statistics")
    gain = norm.weight / torch.sqrt(norm.running_var + norm.eps)
    bias = norm.bias - norm.running_mean * gain
    return (encoder.linear.weight * gain[:, None]).detach(), bias.detach()


def has_bf16_units() -> bool:
    """Return whether this CPU multiplies bfloat16 natively (AMX or AVX-512)."""
    try:
        capabilities = torch.cpu.get_capabilities()
    except AttributeError:  # a torch that is too old to tell
        return False
    return bool(capabilities.get("amx_bf16") or capabilities.get("avx512_bf16"))


def keep_freed_memory() -> None:
    """Let the C library keep up to `KEPT_BYTES` of freed memory, where it can be told so (glibc).

    Otherwise each feature map is fetched from the system and given back, page by page: a tenth of
    the time of a pass.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    mallopt(_M_MMAP_THRESHOLD, LARGEST_KEPT_BYTES)
    mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES)


def use_threads(count: int) -> None:
    """Set the number of CPU threads of torch and of numba; 0 keeps torch's own count.

    The order matters: where both share one OpenMP, starting numba's threads sets the count of
    torch to the number of cores, so torch is told last. Sums over more threads round differently.
    """
    count = count or torch.get_num_threads()
    numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))
    torch.set_num_threads(count)
