"""Weights on disk: safetensors with the network's shape in the header."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import torch
from pydantic import ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from mottrack.core.errors import DataError
from mottrack.flow.pillarflow.calibration import Calibration
from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.network import PillarFlowNet

FORMAT = "mottrack-pillarflow"


@dataclass(frozen=True)
class Weights:
    """A trained network and what it was trained for."""

    network: PillarFlowNet
    """In evaluation mode."""
    calibration: Calibration
    """Of its covariance, on held-out examples."""
    ground_removed: bool
    """Whether it was trained on sweeps without ground."""


def save_weights(file: Path, weights: Weights) -> None:
    """Write a trained network, atomically."""
    header = {
        "format": FORMAT,
        "network": weights.network.config.model_dump_json(),
        "covariance_scale": repr(weights.calibration.scale),
        "claim_sigma_m": repr(weights.calibration.sigma_m),
        "claim_half_m": repr(weights.calibration.half_m),
        "ground_removed": json.dumps(weights.ground_removed),
    }
    state = {k: v.detach().cpu().contiguous() for k, v in weights.network.state_dict().items()}
    temporary = file.with_suffix(".part")
    save_file(state, temporary, header)
    temporary.replace(file)


def load_weights(file: Path) -> Weights:
    """Read a trained network; raises DataError for an absent, torn, foreign or mismatched file."""
    if not file.is_file():
        raise DataError(file, "weights", "absent", "a .safetensors file of mottrack")
    try:
        with safe_open(file, framework="pt") as handle:
            header = handle.metadata() or {}
            if header.get("format") != FORMAT:
                raise DataError(file, "format", header.get("format"), FORMAT)
            state = {name: handle.get_tensor(name) for name in handle.keys()}  # noqa: SIM118
        config = NetworkConfig.model_validate_json(header["network"])
        calibration = _calibration(header)
        ground_removed = bool(json.loads(header["ground_removed"]))
    except (SafetensorError, OSError, KeyError, ValueError, ValidationError) as error:
        told = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DataError(file, "content", told, "weights written by mottrack") from error
    return Weights(_filled(file, config, state), calibration, ground_removed)


def _calibration(header: dict[str, str]) -> Calibration:
    """Files from before the error of a claim was fitted have none."""
    numbers = [
        float(header["covariance_scale"]),
        float(header.get("claim_sigma_m", 0.0)),
        float(header.get("claim_half_m", 0.1)),
    ]
    if not all(math.isfinite(number) and number >= 0 for number in numbers):
        raise ValueError(f"calibration {numbers} is not finite and positive")
    return Calibration(*numbers)


def _filled(file: Path, config: NetworkConfig, state: dict[str, torch.Tensor]) -> PillarFlowNet:
    network = PillarFlowNet(config)
    wanted = network.state_dict()
    if wanted.keys() != state.keys():
        differing = sorted(wanted.keys() ^ state.keys())[:3]
        raise DataError(file, "tensors", f"differing in {differing}", "those of its network")
    for name, value in state.items():
        if value.shape != wanted[name].shape:
            raise DataError(file, name, tuple(value.shape), f"shape {tuple(wanted[name].shape)}")
        if not torch.isfinite(value).all():
            raise DataError(file, name, "not finite", "finite weights")
    network.load_state_dict(state)
    return network.eval()
