"""A trained network made ready to run: numpy points in, motion and covariance out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch

from mottrack.core.arrays import F32
from mottrack.flow.pillarflow.calibration import Calibration
from mottrack.flow.pillarflow.descriptors import CellGrid
from mottrack.flow.pillarflow.inference.fold import folded, folded_linear
from mottrack.flow.pillarflow.inference.pillars import binary_image, pillar_image
from mottrack.flow.pillarflow.layers import channels_last
from mottrack.flow.pillarflow.network import Estimate
from mottrack.flow.pillarflow.pillar_net import PillarEncoder
from mottrack.flow.pillarflow.weights_file import Weights


@dataclass(frozen=True)
class Motion:
    """The network's word on its own cells, in metres over the interval."""

    motion_m: F32
    """(rows,columns,2) way of each cell since the previous sweep."""
    covariance_m2: F32
    """(rows,columns,2,2) covariance of its error."""
    stride: int
    """Pillars along the edge of one of these cells."""


class Engine(Protocol):
    """Runs one network on one device."""

    def run(self, previous: F32, current: F32, seen: F32, cells: CellGrid) -> Motion:
        """Points (N,4) of both sweeps and seen (4,rows,columns) -> motion."""
        ...


class CpuEngine:
    """Folded weights, channels-last convolutions, numba pillars and cost volumes."""

    def __init__(self, weights: Weights, *, half: bool = False) -> None:
        """Fold once; `half` runs the convolutions in bfloat16 (matching stays in float32)."""
        self.half = half
        config = weights.network.config
        self.stride, self.calibration = config.output_stride, weights.calibration
        flow = folded(weights.network.flow)
        self.flow = channels_last(flow)
        encoder = weights.network.encoder
        self.layer: tuple[F32, F32] | None = None
        if isinstance(encoder, PillarEncoder):
            weight, bias = folded_linear(encoder)
            self.layer = weight.numpy(), bias.numpy()

    def image(self, points: F32, cells: CellGrid) -> F32:
        """Pseudo-image (rows,columns,C) of one sweep."""
        if self.layer is None:
            return binary_image(points, cells)
        return pillar_image(points, cells, *self.layer)

    def run(self, previous: F32, current: F32, seen: F32, cells: CellGrid) -> Motion:
        """Points (N,4) of both sweeps and seen (4,rows,columns) -> motion."""
        one, two = (_batched(image) for image in self.images(current, previous, cells))
        return self.flow_of(one, two, torch.from_numpy(seen)[None])

    def images(self, current: F32, previous: F32, cells: CellGrid) -> list[F32]:
        """Pseudo-images of both sweeps, side by side (the loops release the lock)."""
        with ThreadPoolExecutor(min(2, torch.get_num_threads())) as pool:
            return list(pool.map(lambda points: self.image(points, cells), (current, previous)))

    @torch.inference_mode()
    def flow_of(self, current: torch.Tensor, previous: torch.Tensor, seen: torch.Tensor) -> Motion:
        """Pseudo-images (1,C,H,W), channels last -> motion."""
        with torch.autocast("cpu", torch.bfloat16, enabled=self.half):
            estimate = self.flow(current, previous, seen)
        return as_motion(estimate, self.stride, self.calibration)


def has_bf16_units() -> bool:
    """Whether this CPU multiplies bfloat16 natively (AMX or AVX-512); older torch cannot tell."""
    capabilities: dict[str, object] = getattr(torch.cpu, "get_capabilities", dict)()
    return bool(capabilities.get("amx_bf16") or capabilities.get("avx512_bf16"))


def as_motion(estimate: Estimate, stride: int, calibration: Calibration) -> Motion:
    """The first row of a batch as arrays."""
    motion = estimate.motions[-1][0].permute(1, 2, 0).float().cpu().numpy()
    factor = estimate.factor[0].permute(1, 2, 0).float().cpu().numpy()
    covariance_m2 = calibration.covariance_m2(covariance_of(factor), motion)
    return Motion(np.ascontiguousarray(motion), covariance_m2, stride)


def covariance_of(factor: F32) -> F32:
    """L L^T (...,2,2) from (log L_xx, L_yx, log L_yy) (...,3)."""
    xx, yx, yy = np.exp(factor[..., 0]), factor[..., 1], np.exp(factor[..., 2])
    rows = ((xx * xx, xx * yx), (xx * yx, yx * yx + yy * yy))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2).astype(np.float32)


def _batched(image: F32) -> torch.Tensor:
    return torch.from_numpy(image)[None].permute(0, 3, 1, 2)
