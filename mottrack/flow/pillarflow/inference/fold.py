"""Batch normalisation folded into the layers before it."""

from __future__ import annotations

import copy
from itertools import pairwise
from typing import TypeVar

import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from mottrack.flow.pillarflow.pillar_net import PillarEncoder

Module = TypeVar("Module", bound=nn.Module)


def folded(module: Module) -> Module:
    """A copy in evaluation mode whose convolutions have swallowed their normalisation."""
    module = copy.deepcopy(module).eval()
    for part in module.modules():
        if isinstance(part, nn.Sequential):
            _fold_sequence(part)
    return module


def _fold_sequence(sequence: nn.Sequential) -> None:
    layers = list(sequence)
    for index, (first, second) in enumerate(pairwise(layers)):
        if isinstance(first, nn.Conv2d) and isinstance(second, nn.BatchNorm2d):
            sequence[index] = fuse_conv_bn_eval(first, second)
            sequence[index + 1] = nn.Identity()


def folded_linear(encoder: PillarEncoder) -> tuple[torch.Tensor, torch.Tensor]:
    """Weight (C,9) and bias (C,) of the encoder's linear layer with its normalisation."""
    norm = encoder.norm
    if norm.running_var is None or norm.running_mean is None:
        raise TypeError("the encoder's normalisation keeps no statistics")
    gain = norm.weight / torch.sqrt(norm.running_var + norm.eps)
    bias = norm.bias - norm.running_mean * gain
    return (encoder.linear.weight * gain[:, None]).detach(), bias.detach()
