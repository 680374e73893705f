"""The rows of Table II: other networks, and the ground kept, where there are weights for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mottrack.experiment.experiment import Experiment, compose
from mottrack.flow.pillarflow.source import SHIPPED
from mottrack.paper.plan import config_file

ABLATIONS = ("spynet", "flownet", "with_ground", "pwc")


def ablation_weights(name: str, folder: Path | None) -> str | None:
    """Weights of a row of Table II: from the folder, else shipped ones, else None."""
    if folder is not None and (folder / name / "weights.safetensors").is_file():
        return str(folder / name / "weights.safetensors")
    return name if (SHIPPED / f"{name}.safetensors").is_file() else None


def ablation_runs(
    tree: Mapping[str, Any], overrides: Sequence[str], folder: Path | None
) -> list[Experiment]:
    """The flow study's experiment with every network that has weights.

    Raises:
        ConfigError: a setting is wrong.
    """
    found = []
    for name in ABLATIONS:
        weights = ablation_weights(name, folder)
        if weights is None:
            continue
        flow: dict[str, Any] = {"kind": "pillarflow", "weights": weights, "refined": False}
        if name == "with_ground":
            flow["stages"] = {"ground": {"enabled": False}}
        run = compose({**tree, "flow": flow}, overrides, config_file("flow"))[0]
        found.append(replace(run, variant=name))
    return found
