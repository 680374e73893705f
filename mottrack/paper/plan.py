"""What is asked for and what is run for it: the shipped plan, the request, a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from mottrack.config import StrictModel
from mottrack.core.errors import ConfigError
from mottrack.experiment.configs import shipped_folder
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.validation_message import format_validation_error
from mottrack.experiment.yaml_file import read_yaml

STUDIES = ("flow", "tracking", "velocity")
"""What recorded data can serve; the embedded world also serves the ball and the runtimes."""
WORLD = "world"


class RecordedPlan(StrictModel):
    """How a recorded data set enters the studies."""

    title: str = Field(description="its name in the report")
    dataset: dict[str, Any] = Field(description="settings beside its root")
    with_sweeps: dict[str, Any] = Field(default={}, description="further: only frames with sweeps")
    scenes: int = Field(ge=1, description="at most so many, evenly spread")
    quick_scenes: int = Field(ge=1, description="the same for a quick run")
    quick: list[str] = Field(default=[], description="further overrides of a quick run")


class Plan(StrictModel):
    """``configs/paper/plan.yaml``."""

    quick: dict[str, list[str]] = Field(description="overrides of each study")
    recorded: dict[str, RecordedPlan] = Field(description="data sets by name")


@dataclass(frozen=True)
class Request:
    """What the user asked for."""

    out: Path
    quick: bool = False
    roots: Mapping[str, Path] | None = None
    """Recorded data set to its folder."""
    settings: Sequence[str] = ()
    """``NAME.key=value``: settings of recorded data sets, as in ``nuscenes.detections=FILE``."""
    ablation: Path | None = None
    """Folder of weights for Table II, a sub-folder each."""


@dataclass(frozen=True)
class Study:
    """The runs behind one table on one data set."""

    name: str
    dataset: str
    title: str
    """Of the data set."""
    runs: tuple[Experiment, ...]
    left_out: dict[str, str] = field(default_factory=dict)
    """Scenes that can't take part, and why."""
    absent: dict[str, str] = field(default_factory=dict)
    """Variants that are not run, and why."""
    reason: str = ""
    """Why nothing of it is run; empty otherwise."""

    @property
    def folder(self) -> Path:
        """Where its results are, below those of all runs."""
        return Path(self.dataset) / self.name


def config_file(study: str) -> Path:
    """The shipped configuration of a study, or of the plan."""
    return shipped_folder() / "paper" / f"{study}.yaml"


def read_plan() -> Plan:
    """The shipped plan.

    Raises:
        ConfigError: it is not well formed.
    """
    path = config_file("plan")
    try:
        return Plan.model_validate(read_yaml(path))
    except ValidationError as error:
        raise ConfigError(f"{path}: {format_validation_error(error, Plan)}") from error
