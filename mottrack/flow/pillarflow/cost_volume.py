"""The cost volume: correlation of two feature maps over a window (paper, section III-B).

On a CPU numba kernels compute it on channels-last maps (B,H,W,C) in float32. Each row is first laid
out as planes (C, W + 2 radius), zero at both ends, so that the innermost loop runs along the row
over contiguous numbers and needs no test for the edge: about twice as fast as products over the
channels of one cell after the other (one core, AVX-512).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numba import prange
from torch.nn import functional

from mottrack.compiled import compiled
from mottrack.core.arrays import F32


def cost_volume(current: torch.Tensor, previous: torch.Tensor, radius: int) -> torch.Tensor:
    """Correlate (B,C,H,W) with (B,C,H,W): c_s(p) = 1/C f1(p).f2(p + s), |s|_inf <= radius.

    Returns (B, (2 radius + 1)^2, H, W), shifts row by row; zero outside of the grid. On a CPU a
    numba kernel does it (forward and backward); elsewhere, and while a model is exported,
    `cost_volume_by_shifts`.
    """
    traced = torch.onnx.is_in_onnx_export() or torch.compiler.is_compiling()
    if current.device.type != "cpu" or traced:
        return cost_volume_by_shifts(current, previous, radius)
    result: torch.Tensor = _Correlation.apply(current, previous, radius)  # type: ignore[no-untyped-call]
    return result


def cost_volume_by_shifts(
    current: torch.Tensor, previous: torch.Tensor, radius: int
) -> torch.Tensor:
    """Compute the same with slices, products and means: for ONNX and for any device."""
    height, width = current.shape[-2:]
    padded = functional.pad(previous, (radius, radius, radius, radius))
    shifted = (
        padded[..., row : row + height, column : column + width]
        for row in range(2 * radius + 1)
        for column in range(2 * radius + 1)
    )
    return torch.cat([(current * one).mean(1, keepdim=True) for one in shifted], dim=1)


def _channels_last(tensor: torch.Tensor) -> torch.Tensor:
    return tensor.detach().float().permute(0, 2, 3, 1).contiguous()


class _Correlation(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, current: torch.Tensor, previous: torch.Tensor, radius: int
    ) -> torch.Tensor:
        maps = _channels_last(current), _channels_last(previous)
        ctx.save_for_backward(*maps)
        ctx.dtype = current.dtype
        costs = torch.empty((*maps[0].shape[:3], (2 * radius + 1) ** 2))
        _correlate(maps[0].numpy(), maps[1].numpy(), radius, costs.numpy())
        return costs.permute(0, 3, 1, 2)

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        maps = ctx.saved_tensors
        back = [torch.empty_like(one) for one in maps]
        _correlate_backward(
            _channels_last(gradients[0]).numpy(), *(one.numpy() for one in (*maps, *back))
        )
        return *(one.permute(0, 3, 1, 2).to(ctx.dtype) for one in back), None


@compiled(nogil=True, parallel=True, fastmath=True)
def _planes(maps: F32, radius: int) -> F32:
    """(B,H,W,C) -> (B,H,C,W + 2 radius)."""
    batch, height, width, channels = maps.shape
    planes = np.zeros((batch, height, channels, width + 2 * radius), np.float32)
    for line in prange(batch * height):
        b, y = line // height, line % height
        for x in range(width):
            for c in range(channels):
                planes[b, y, c, x + radius] = maps[b, y, x, c]
    return planes


@compiled(nogil=True, fastmath=True)
def _add_product(total: F32, one: F32, two: F32) -> None:
    """Add the product of two rows to a third."""
    for x in range(len(total)):
        total[x] += one[x] * two[x]


@compiled(nogil=True, fastmath=True)
def _add_four_products(total: F32, one: F32, two: F32, c: int, start: int) -> None:
    """Add the products of channels c to c + 3 (C,W): a row is read and written once for four."""
    width = len(total)
    a, b = one[c], two[c, start : start + width]
    d, e = one[c + 1], two[c + 1, start : start + width]
    f, g = one[c + 2], two[c + 2, start : start + width]
    h, i = one[c + 3], two[c + 3, start : start + width]
    for x in range(width):
        total[x] += a[x] * b[x] + d[x] * e[x] + f[x] * g[x] + h[x] * i[x]


@compiled(nogil=True, parallel=True, fastmath=True)
def _correlate(current: F32, previous: F32, radius: int, costs: F32) -> None:
    """Compute costs[b,y,x,s] = 1/C sum_c current[b,y,x,c] previous[b,y+dy,x+dx,c]."""
    batch, height, width, channels = current.shape
    side = 2 * radius + 1
    scale = np.float32(1.0 / channels)
    one, two = _planes(current, 0), _planes(previous, radius)
    for line in prange(batch * height):
        b, y = line // height, line % height
        row = np.zeros((side * side, width), np.float32)
        for s in range(side * side):
            v, start = y + s // side - radius, s % side
            if 0 <= v < height:
                whole = channels - channels % 4
                for c in range(0, whole, 4):
                    _add_four_products(row[s], one[b, y], two[b, v], c, start)
                for c in range(whole, channels):
                    _add_product(row[s], one[b, y, c], two[b, v, c, start : start + width])
        for x in range(width):
            for s in range(side * side):
                costs[b, y, x, s] = row[s, x] * scale


@compiled(nogil=True, fastmath=True)
def _add_products(total: F32, slope: F32, maps: F32, start: int) -> None:
    """Add slope * maps, shifted by `start`, to each channel of `total` (C,W)."""
    width = total.shape[1]
    for c in range(len(total)):
        _add_product(total[c], slope, maps[c, start : start + width])


@compiled(nogil=True, parallel=True, fastmath=True)
def _correlate_backward(
    slope: F32, current: F32, previous: F32, to_current: F32, to_previous: F32
) -> None:
    """Propagate the gradient `slope` of the costs to both maps (each row writes only its own)."""
    batch, height, width, channels = current.shape
    side = round(np.sqrt(slope.shape[3]))
    radius = side // 2
    scale = np.float32(1.0 / channels)
    slopes = _planes(slope, radius)
    one, two = _planes(current, radius), _planes(previous, radius)
    for line in prange(batch * height):
        b, y = line // height, line % height
        row = np.zeros((2, channels, width), np.float32)
        for s in range(side * side):
            dy, right = s // side - radius, s % side
            left = 2 * radius - right
            if 0 <= y + dy < height:
                here = slopes[b, y, s, radius : radius + width]
                _add_products(row[0], here, two[b, y + dy], right)
            if 0 <= y - dy < height:
                there = slopes[b, y - dy, s, left : left + width]
                _add_products(row[1], there, one[b, y - dy], left)
        for x in range(width):
            to_current[b, y, x] = row[0, :, x] * scale
            to_previous[b, y, x] = row[1, :, x] * scale
