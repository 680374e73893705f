"""Weights on disk: safetensors with the network's configuration in the header."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from pydantic import ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from mottrack.core.errors import DataError
from mottrack.core.printed import shown
from mottrack.core.storage import write_bytes
from mottrack.flow.pillarflow.calibration import Calibration
from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.network import PillarFlowNet

FORMAT = "mottrack-pillarflow"
TYPES = {torch.float32: "F32", torch.int64: "I64"}
"""The types that a network has, as safetensors calls them."""
MAX_WEIGHT = 1e9
"""Weights stay below 100, running variances below 1e6; a flipped bit makes them 1e19 and more."""
SUMS = "SHA256SUMS"
"""Beside the shipped files: their digests, as `sha256sum` writes them."""


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
    tensors = contiguous(weights.network.state_dict())
    write_bytes(file, save(tensors, header | {"sha256": _digest(tensors)}))


def load_weights(file: Path) -> Weights:
    """Read a trained network.

    Names, shapes and types of the tensors are compared with the network that the header describes
    before that is built or anything is read.

    Raises:
        DataError: the file is absent, torn, of another format, its tensors are not those of the
            network that its header describes, or are not what was written.
    """
    if not file.is_file():
        raise DataError(file, "weights", "absent", "a .safetensors file of mottrack")
    try:
        with safe_open(file, framework="pt") as handle:
            header = _header(file, handle, FORMAT)
            config = NetworkConfig.model_validate_json(header["network"])
            _require_layout(file, handle, config)
            state = _tensors(handle)
        calibration = _calibration(header)
        ground_removed = bool(json.loads(header["ground_removed"]))
    except (SafetensorError, OSError, KeyError, ValueError, RecursionError) as error:
        raise DataError(file, "content", _reason(error), "weights written by mottrack") from error
    _require_undamaged(file, header, state)
    network = PillarFlowNet(config)
    copy_tensors(file, network.state_dict(), state)
    return Weights(network.eval(), calibration, ground_removed)


@torch.no_grad()
def widen(file: Path, trained: PillarFlowNet, into: PillarFlowNet) -> None:
    """Copy trained weights into a network that may have more inputs, in place.

    The weights of inputs that the trained network does not have are zero, so both give the same
    output: further inputs come last in every layer.

    Args:
        file: of the trained weights, named in errors.
        trained: the trained network.
        into: the network, of the same backbone.

    Raises:
        DataError: they differ in more than the number of inputs.
    """
    mine, theirs = into.state_dict(), trained.state_dict()
    same = trained.config.backbone == into.config.backbone
    if mine.keys() != theirs.keys() or not same:
        differing = sorted(mine.keys() ^ theirs.keys())[:3] or [trained.config.backbone]
        raise DataError(file, "network", f"differing in {differing}", "that of the run")
    for name, value in theirs.items():
        own = mine[name]
        if own.shape == value.shape:
            own.copy_(value)
            continue
        count = value.shape[1] if value.ndim == 4 else 0
        wider = 0 < count < own.shape[1] and own[:, :count].shape == value.shape
        # the images of both sweeps lie beside each other in the first layer of a SpyNet
        if not wider or into.config.backbone != "pwc":
            raise DataError(file, name, tuple(value.shape), f"shape {tuple(own.shape)}")
        own.zero_()
        own[:, :count].copy_(value)


def first_problem(error: ValidationError) -> str:
    """Return the first key of a network's settings that is wrong, its value and why."""
    first = error.errors()[0]
    name = ".".join(map(str, first["loc"]))
    return f"{name} = {shown(first['input'])} ({first['msg']})"


def _reason(error: Exception) -> str:
    if isinstance(error, ValidationError):
        return first_problem(error)
    return str(error).splitlines()[0] if str(error) else type(error).__name__


def _require_layout(file: Path, handle: Any, config: NetworkConfig) -> None:
    """Refuse other names, shapes or types than the network has that the header describes."""
    with torch.device("meta"):  # shapes without memory
        expected = PillarFlowNet(config).state_dict()
    names = set(handle.keys())
    if names != expected.keys():
        differing = sorted(names ^ expected.keys())[:3]
        raise DataError(file, "tensors", f"differing in {differing}", "those of the network")
    for name, value in expected.items():
        stored = handle.get_slice(name)
        found = (stored.get_dtype(), tuple(stored.get_shape()))
        if found != (TYPES[value.dtype], tuple(value.shape)):
            words = f"{TYPES[value.dtype]} {tuple(value.shape)}"
            raise DataError(file, name, f"{found[0]} {found[1]}", words)


def _require_undamaged(file: Path, header: dict[str, str], state: dict[str, torch.Tensor]) -> None:
    """Refuse tensors that are not what was written, or that no training ends with."""
    for name, value in state.items():
        if not torch.isfinite(value).all():
            raise DataError(file, name, "not finite", "finite weights")
        if value.dtype.is_floating_point and value.abs().max() > MAX_WEIGHT:
            worst = float(value.abs().max())
            raise DataError(file, name, f"up to {worst:.3g}", f"within {MAX_WEIGHT:g}")
    stored, actual = header.get("sha256"), _digest(state)
    if stored is not None and stored != actual:
        raise DataError(file, "checksum", stored[:12], f"{actual[:12]} (damaged?)")
    _require_shipped(file)


def _require_shipped(file: Path) -> None:
    """Refuse one of the files that come with the package if it is not the one that was packed."""
    sums = file.parent / SUMS
    if not sums.is_file():
        return
    lines = (line.split() for line in sums.read_text(encoding="utf-8").splitlines())
    known = {name: digest for digest, name in lines}
    actual = hashlib.sha256(file.read_bytes()).hexdigest()
    expected = known.get(file.name, actual)
    if actual != expected:
        raise DataError(file, "checksum", actual[:12], f"{expected[:12]} (damaged?)")


def _digest(tensors: dict[str, torch.Tensor]) -> str:
    """Return the SHA-256 of names, types, shapes and values."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        value = tensors[name]
        digest.update(f"{name} {value.dtype} {tuple(value.shape)}\0".encode())
        digest.update(value.numpy().tobytes())
    return digest.hexdigest()


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
        return _header(file, handle, form), _tensors(handle)


def _header(file: Path, handle: Any, form: str) -> dict[str, str]:
    header: dict[str, str] = handle.metadata() or {}
    if header.get("format") != form:
        raise DataError(file, "format", header.get("format"), form)
    return header


def _tensors(handle: Any) -> dict[str, torch.Tensor]:
    return {name: handle.get_tensor(name) for name in handle.keys()}  # noqa: SIM118


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
