"""Weights on disk: safetensors with the network's configuration in the header."""

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
    """A trained network and the conditions it was trained for."""

    network: PillarFlowNet
    """In evaluation mode."""
    calibration: Calibration
    """Of its covariance, on held-out examples."""
    ground_removed: bool
    """Whether it was trained on sweeps without ground."""


def save_weights(file: Path, weights: Weights) -> None:
    """Write a trained network atomically."""
    header = {
        "format": FORMAT,
        "network": weights.network.config.model_dump_json(),
        "covariance_scale": repr(weights.calibration.scale),
        "claim_sigma_m": repr(weights.calibration.sigma_m),
        "claim_half_m": repr(weights.calibration.half_m),
        "ground_removed": json.dumps(weights.ground_removed),
    }
    temporary = file.with_suffix(".part")
    save_file(contiguous(weights.network.state_dict()), temporary, header)
    temporary.replace(file)


def load_weights(file: Path) -> Weights:
    """Read a trained network.

    Raises:
        DataError: the file is absent, torn, of another format, or its tensors are not those of the
            network that its header describes.
    """
    if not file.is_file():
        raise DataError(file, "weights", "absent", "a .safetensors file of mottrack")
    try:
        header, state = read_tensors(file, FORMAT)
        network = PillarFlowNet(NetworkConfig.model_validate_json(header["network"]))
        calibration = _calibration(header)
        ground_removed = bool(json.loads(header["ground_removed"]))
    except (SafetensorError, OSError, KeyError, ValueError, ValidationError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DataError(file, "content", reason, "weights written by mottrack") from error
    copy_tensors(file, network.state_dict(), state)
    for name, value in state.items():
        if not torch.isfinite(value).all():
            raise DataError(file, name, "not finite", "finite weights")
    return Weights(network.eval(), calibration, ground_removed)


def _calibration(header: dict[str, str]) -> Calibration:
    numbers = [
        float(header["covariance_scale"]),
        # the shipped ablations (pwc, spynet, flownet, with_ground) have a scale alone
        float(header.get("claim_sigma_m", 0.0)),
        float(header.get("claim_half_m", 0.1)),
    ]
    if not all(math.isfinite(number) and number >= 0 for number in numbers):
        raise ValueError(f"calibration {numbers} is not finite and positive")
    return Calibration(*numbers)


def contiguous(tensors: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return the tensors on the CPU, laid out as safetensors wants them."""
    return {name: value.detach().cpu().contiguous() for name, value in tensors.items()}


def read_tensors(file: Path, form: str) -> tuple[dict[str, str], dict[str, torch.Tensor]]:
    """Return header and tensors of a safetensors file.

    Raises:
        DataError: its header does not say the format `form`.
        SafetensorError: it is torn or no safetensors file.
    """
    with safe_open(file, framework="pt") as handle:
        header = handle.metadata() or {}
        if header.get("format") != form:
            raise DataError(file, "format", header.get("format"), form)
        return header, {name: handle.get_tensor(name) for name in handle.keys()}  # noqa: SIM118


@torch.no_grad()
def copy_tensors(
    file: Path, into: dict[str, torch.Tensor], values: dict[str, torch.Tensor]
) -> None:
    """Copy the tensors read from `file` into those of a network, in place.

    Raises:
        DataError: names or shapes are not the same.
    """
    if into.keys() != values.keys():
        differing = sorted(into.keys() ^ values.keys())[:3]
        raise DataError(file, "tensors", f"differing in {differing}", "those of the network")
    for name, value in values.items():
        if into[name].shape != value.shape:
            raise DataError(file, name, tuple(value.shape), f"shape {tuple(into[name].shape)}")
        into[name].copy_(value)
