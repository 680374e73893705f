"""The cost volume: correlation of two feature maps over a window (paper, section III-B)."""

from __future__ import annotations

from typing import Any

import torch
from torch.nn import functional

from mottrack.flow.pillarflow import correlation_kernels as kernels


def cost_volume(current: torch.Tensor, previous: torch.Tensor, reach: int) -> torch.Tensor:
    """Correlate (B,C,H,W) with (B,C,H,W): c_s(p) = 1/C f1(p).f2(p + s), |s|_inf <= reach.

    Returns (B, (2 reach + 1)^2, H, W), shifts row by row; zero outside of the grid. On a CPU a
    numba kernel does it (forward and backward); elsewhere, and while a model is exported,
    `cost_volume_by_shifts`.
    """
    plain = torch.onnx.is_in_onnx_export() or torch.compiler.is_compiling()
    if current.device.type != "cpu" or plain:
        return cost_volume_by_shifts(current, previous, reach)
    result: torch.Tensor = _Correlation.apply(current, previous, reach)  # type: ignore[no-untyped-call]
    return result


def cost_volume_by_shifts(
    current: torch.Tensor, previous: torch.Tensor, reach: int
) -> torch.Tensor:
    """The same with plain slices, products and means: exports to ONNX and runs on any device."""
    height, width = current.shape[-2:]
    padded = functional.pad(previous, (reach, reach, reach, reach))
    shifted = (
        padded[..., row : row + height, column : column + width]
        for row in range(2 * reach + 1)
        for column in range(2 * reach + 1)
    )
    return torch.cat([(current * one).mean(1, keepdim=True) for one in shifted], dim=1)


def _channels_last(tensor: torch.Tensor) -> torch.Tensor:
    return tensor.detach().float().permute(0, 2, 3, 1).contiguous()


class _Correlation(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, current: torch.Tensor, previous: torch.Tensor, reach: int
    ) -> torch.Tensor:
        one, two = _channels_last(current), _channels_last(previous)
        ctx.save_for_backward(one, two)
        ctx.reach, ctx.dtype = reach, current.dtype
        costs = torch.empty((*one.shape[:3], (2 * reach + 1) ** 2))
        kernels.correlate(one.numpy(), two.numpy(), reach, costs.numpy())
        return costs.permute(0, 3, 1, 2)

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, None]:
        one, two = ctx.saved_tensors
        slope = _channels_last(gradients[0]).numpy()
        to_one, to_two = torch.empty_like(one), torch.empty_like(two)
        kernels.correlate_backward(slope, one.numpy(), two.numpy(), to_one.numpy(), to_two.numpy())
        back = [g.permute(0, 3, 1, 2).to(ctx.dtype) for g in (to_one, to_two)]
        return back[0], back[1], None
