"""The one convolution block that every part of the network is built of."""

from __future__ import annotations

from typing import TypeVar

import torch
from torch import nn

Module = TypeVar("Module", bound=nn.Module)

LEAK = 0.1


def conv_block(
    inputs: int, outputs: int, *, stride: int = 1, dilation: int = 1, kernel: int = 3
) -> nn.Sequential:
    """Convolution without bias, batch normalisation, LeakyReLU(0.1); keeps the size at stride 1."""
    padding = dilation * (kernel // 2)
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, padding, dilation, bias=False),
        nn.BatchNorm2d(outputs),
        nn.LeakyReLU(LEAK, inplace=True),
    )


def small_init(layer: nn.Conv2d, std: float = 1e-3) -> nn.Conv2d:
    """Start an output layer near zero, so that the first flow is "nothing moves"."""
    nn.init.normal_(layer.weight, std=std)
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)
    return layer


def channels_last(module: Module) -> Module:
    """The module with its convolutions in the memory order that CPUs and tensor cores prefer."""
    moved: Module = module.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    return moved


def side_by_side(parts: list[torch.Tensor]) -> torch.Tensor:
    """Maps (B,.,H,W) joined along the channels, in the precision of the convolution that follows.

    Under autocast `torch.cat` would widen all of them to float32 first and the convolution narrow
    the result again: the same numbers, at a quarter of the whole network's time on a CPU.
    """
    device = parts[0].device.type
    if device != "cpu" or not torch.is_autocast_enabled(device) or torch.is_grad_enabled():
        return torch.cat(parts, dim=1)
    dtype = torch.get_autocast_dtype(device)
    layout = torch.channels_last
    with torch.autocast(device, enabled=False):
        return torch.cat([part.to(dtype, memory_format=layout) for part in parts], dim=1)
