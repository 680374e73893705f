"""Checkpoints: one safetensors file with weights, average, optimiser state and the curve so far."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import save_file
from torch import nn
from torch.optim import Optimizer

from mottrack.core.errors import DataError
from mottrack.flow.pillarflow.network import PillarFlowNet
from mottrack.flow.pillarflow.weights_file import contiguous, copy_tensors, read_tensors

FORMAT = "mottrack-pillarflow-checkpoint"


class WeightAverage:
    """Exponential moving average of parameters and batch-normalisation statistics."""

    def __init__(self, network: nn.Module, decay: float) -> None:
        """Start from the present weights."""
        self.decay = decay
        self.state = {k: v.detach().clone() for k, v in network.state_dict().items()}

    @torch.no_grad()
    def update(self, network: nn.Module, step: int) -> None:
        """Move towards the weights after `step` (0, 1, ..)."""
        # over the first steps the average forgets faster, or the initial weights would stay in it
        decay = min(self.decay, (1.0 + step) / (10.0 + step))
        for name, value in network.state_dict().items():
            mean = self.state[name]
            if mean.is_floating_point():
                mean.lerp_(value, 1.0 - decay)
            else:
                mean.copy_(value)


@dataclass
class Progress:
    """Progress of a run."""

    step: int = 0
    """Steps taken."""
    seconds: float = 0.0
    """Time spent in them, interruptions left out."""
    history: list[dict[str, float]] = field(default_factory=list)
    """Points of the loss and validation curves."""


@dataclass(frozen=True)
class TrainingState:
    """Everything that a resumed run needs."""

    network: PillarFlowNet
    average: WeightAverage
    optimiser: Optimizer
    progress: Progress

    def save(self, file: Path) -> None:
        """Write a checkpoint atomically: a run that is killed leaves the last whole one."""
        tensors = {f"model.{k}": v for k, v in self.network.state_dict().items()}
        tensors |= {f"average.{k}": v for k, v in self.average.state.items()}
        moments: dict[int, dict[str, Any]] = self.optimiser.state_dict()["state"]
        for index, state in moments.items():
            tensors |= {f"optimiser.{index}.{k}": torch.as_tensor(v) for k, v in state.items()}
        temporary = file.with_suffix(".part")
        header = {"format": FORMAT, "progress": json.dumps(asdict(self.progress))}
        save_file(contiguous(tensors), temporary, header)
        temporary.replace(file)

    def load(self, file: Path) -> None:
        """Restore a checkpoint in place.

        Raises:
            DataError: the file is torn, of another format or of another network.
        """
        try:
            header, tensors = read_tensors(file, FORMAT)
        except (SafetensorError, OSError) as error:
            expected = "a checkpoint of `mottrack train`"
            raise DataError(file, "content", str(error), expected) from error
        copy_tensors(file, self.network.state_dict(), _under(tensors, "model."))
        copy_tensors(file, self.average.state, _under(tensors, "average."))
        self._restore_optimiser(_under(tensors, "optimiser."))
        progress = Progress(**json.loads(header["progress"]))
        self.progress.step, self.progress.seconds = progress.step, progress.seconds
        self.progress.history[:] = progress.history

    def _restore_optimiser(self, tensors: dict[str, torch.Tensor]) -> None:
        parameters = [one for group in self.optimiser.param_groups for one in group["params"]]
        states: dict[int, dict[str, Any]] = {}
        for name, value in tensors.items():
            index, key = name.split(".", 1)
            states.setdefault(int(index), {})[key] = _laid_out_as(parameters[int(index)], value)
        groups = self.optimiser.state_dict()["param_groups"]
        self.optimiser.load_state_dict({"state": states, "param_groups": groups})


def _laid_out_as(parameter: torch.Tensor, value: torch.Tensor) -> torch.Tensor:
    """Return the value in the parameter's memory order, in which a fused optimiser reads both."""
    if value.shape != parameter.shape:
        return value
    return torch.empty_like(parameter, dtype=value.dtype).copy_(value)


def _under(tensors: dict[str, torch.Tensor], prefix: str) -> dict[str, torch.Tensor]:
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
