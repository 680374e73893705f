"""Checkpoints: one safetensors file with weights, average, optimiser state and the curve so far."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import nn
from torch.optim import Optimizer

from mottrack.core.errors import DataError
from mottrack.flow.pillarflow.training.average import WeightAverage

FORMAT = "mottrack-pillarflow-checkpoint"


@dataclass
class Progress:
    """What a run has done."""

    step: int
    """Steps taken."""
    seconds: float
    """Time spent in them, over all sittings."""
    history: list[dict[str, float]]
    """Points of the loss and validation curves."""


def save_checkpoint(
    file: Path, network: nn.Module, average: WeightAverage, optimiser: Optimizer, progress: Progress
) -> None:
    """Write atomically: a run that is killed leaves the last whole checkpoint."""
    tensors = {f"model.{k}": v for k, v in network.state_dict().items()}
    tensors |= {f"average.{k}": v for k, v in average.state.items()}
    moments: dict[int, dict[str, Any]] = optimiser.state_dict()["state"]
    for index, state in moments.items():
        tensors |= {f"optimiser.{index}.{k}": torch.as_tensor(v) for k, v in state.items()}
    about = {"step": progress.step, "seconds": progress.seconds, "history": progress.history}
    temporary = file.with_suffix(".part")
    ready = {k: v.detach().cpu().contiguous() for k, v in tensors.items()}
    save_file(ready, temporary, {"format": FORMAT, "progress": json.dumps(about)})
    temporary.replace(file)


def load_checkpoint(
    file: Path, network: nn.Module, average: WeightAverage, optimiser: Optimizer
) -> Progress:
    """Restore a run in place; raises DataError for a torn, foreign or mismatched file."""
    tensors, progress = _read(file)
    _restore(file, network.state_dict(), _under(tensors, "model."))
    _restore(file, average.state, _under(tensors, "average."))
    states: dict[int, dict[str, Any]] = {}
    for name, value in _under(tensors, "optimiser.").items():
        index, key = name.split(".", 1)
        states.setdefault(int(index), {})[key] = value
    parameters = [one for group in optimiser.param_groups for one in group["params"]]
    for row, state in states.items():
        states[row] = {k: _laid_out_as(parameters[row], v) for k, v in state.items()}
    whole = optimiser.state_dict()
    optimiser.load_state_dict({"state": states, "param_groups": whole["param_groups"]})
    return progress


def _laid_out_as(parameter: torch.Tensor, value: torch.Tensor) -> torch.Tensor:
    """The value with the parameter's strides: a fused optimiser walks both in memory order."""
    if value.shape != parameter.shape:
        return value
    return torch.empty_like(parameter, dtype=value.dtype).copy_(value)


def _read(file: Path) -> tuple[dict[str, torch.Tensor], Progress]:
    try:
        with safe_open(file, framework="pt") as handle:
            about = handle.metadata() or {}
            if about.get("format") != FORMAT:
                raise DataError(file, "format", about.get("format"), FORMAT)
            tensors = {name: handle.get_tensor(name) for name in handle.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise DataError(file, "content", str(error), "a checkpoint of `mottrack train`") from error
    return tensors, Progress(**json.loads(about["progress"]))


def _under(tensors: dict[str, torch.Tensor], prefix: str) -> dict[str, torch.Tensor]:
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}


@torch.no_grad()
def _restore(file: Path, into: dict[str, torch.Tensor], values: dict[str, torch.Tensor]) -> None:
    if into.keys() != values.keys():
        differing = sorted(into.keys() ^ values.keys())[:3]
        raise DataError(file, "tensors", f"differing in {differing}", "those of the network")
    for name, value in values.items():
        if into[name].shape != value.shape:
            raise DataError(file, name, tuple(value.shape), f"shape {tuple(into[name].shape)}")
        into[name].copy_(value)
