"""The shipped plan of the studies, the user's request, a study, and the networks of Table II."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from mottrack.config import StrictModel
from mottrack.core.errors import ConfigError
from mottrack.experiment.configs import shipped_folder
from mottrack.experiment.criteria import Criterion
from mottrack.experiment.experiment import Experiment, compose
from mottrack.experiment.validation_message import format_validation_error
from mottrack.flow.pillarflow.source import SHIPPED
from mottrack.formats.yaml_file import read_yaml

STUDIES = ("flow", "tracking", "tracking_default", "velocity", "velocity_printed")
"""Studies that recorded data can serve; the embedded world also serves the ball and runtimes. Two
of one table, as printed and with the default settings, have the scenes in common."""
WORLD = "world"
ABLATIONS = ("spynet", "flownet", "with_ground", "pwc", "binary_ogm_equal")
"""Variants of Tables I and II that had one recipe; `pwc` is PillarFlow's own network."""


class RecordedPlan(StrictModel):
    """How a recorded data set enters the studies."""

    title: str = Field(description="name in the report")
    dataset: dict[str, Any] = Field(description="settings beside its root")
    with_sweeps: dict[str, Any] = Field(
        default={}, description="further settings that restrict it to frames with sweeps"
    )
    scenes: int = Field(ge=1, description="maximum number of scenes, evenly spread")
    quick_scenes: int = Field(ge=1, description="the same for a quick run")
    quick: list[str] = Field(default=[], description="further overrides of a quick run")


class Plan(StrictModel):
    """``configs/paper/plan.yaml``."""

    quick: dict[str, list[str]] = Field(description="overrides of each study in a quick run")
    recorded: dict[str, RecordedPlan] = Field(description="data sets by name")


@dataclass(frozen=True)
class Request:
    """What the user asked for."""

    out: Path
    quick: bool = False
    roots: Mapping[str, Path] = field(default_factory=dict)
    """Recorded data set to its folder."""
    settings: Sequence[str] = ()
    """``NAME.key=value``: settings of recorded data sets, as in ``nuscenes.detections=FILE``."""
    ablation: Path | None = None
    """Folder of weights for Table II with a sub-folder each."""


@dataclass(frozen=True)
class Study:
    """The runs behind one table on one data set."""

    name: str
    dataset: str
    title: str
    """Of the data set."""
    runs: tuple[Experiment, ...]
    left_out: dict[str, str] = field(default_factory=dict)
    """Scenes that can't take part to the reason."""
    absent: dict[str, str] = field(default_factory=dict)
    """Variants that are not run to the reason."""
    reason: str = ""
    """Why nothing of it is run; empty otherwise."""

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        """What is claimed of its runs in its file."""
        return self.runs[0].settings.criteria if self.runs else ()

    @property
    def folder(self) -> Path:
        """Folder of its results below those of all runs."""
        return Path(self.dataset) / self.name


def config_file(study: str) -> Path:
    """Return the shipped configuration of a study, or the plan."""
    return shipped_folder() / "paper" / f"{study}.yaml"


def read_plan() -> Plan:
    """Read the shipped plan.

    Raises:
        ConfigError: it is not well formed.
    """
    path = config_file("plan")
    try:
        return Plan.model_validate(read_yaml(path))
    except ValidationError as error:
        raise ConfigError(f"{path}: {format_validation_error(error, Plan)}") from error


def ablation_weights(name: str, folder: Path | None) -> str | None:
    """Return the weights of a row of Table II: from the folder, else shipped ones, else None."""
    if folder is not None and (folder / name / "weights.safetensors").is_file():
        return str(folder / name / "weights.safetensors")
    return name if (SHIPPED / f"{name}.safetensors").is_file() else None


def ablation_runs(
    tree: Mapping[str, Any], overrides: Sequence[str], folder: Path | None
) -> list[Experiment]:
    """Return the flow study's experiment with every network of Table II that has weights.

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
