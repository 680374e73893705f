"""What is run: the studies behind the paper's tables, on the embedded world and recorded data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, ValidationError

from mottrack.config import StrictModel
from mottrack.core.errors import ConfigError, DataError
from mottrack.flow.pillarflow.weights_file import SHIPPED
from mottrack.pipeline.configs import shipped_folder
from mottrack.pipeline.experiment import Experiment, compose
from mottrack.pipeline.explain import explain
from mottrack.pipeline.runner import scene_names
from mottrack.pipeline.yaml_file import read_yaml

STUDIES = ("flow", "tracking", "velocity")
ABLATIONS = ("spynet", "flownet", "with_ground", "pwc")
WORLD = "world"
NEEDS_DETECTIONS = ("icp", "icp_one_start")


class RecordedPlan(StrictModel):
    """How a recorded data set enters the studies."""

    title: str = Field(description="its name in the report")
    dataset: dict[str, Any] = Field(description="settings beside its root")
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
    detections: Mapping[str, Path] | None = None
    """Recorded data set to its detection file, where it has one."""
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

    @property
    def folder(self) -> Path:
        """Where its results are, below those of all runs."""
        return Path(self.dataset) / self.name


def folder_of_configs() -> Path:
    """Where the configurations of the studies are."""
    return shipped_folder() / "paper"


def read_plan() -> Plan:
    """The shipped plan.

    Raises:
        ConfigError: it is not well formed.
    """
    path = folder_of_configs() / "plan.yaml"
    try:
        return Plan.model_validate(read_yaml(path))
    except ValidationError as error:
        raise ConfigError(f"{path}: {explain(error, Plan)}") from error


def studies(request: Request) -> list[Study]:
    """Every study that is asked for.

    Raises:
        ConfigError: a data set is unknown, or does not fit its settings.
        DataError: a data set is not where it is said to be.
    """
    plan = read_plan()
    found = [_world(name, plan, request) for name in (*STUDIES, "ball", "runtime")]
    for name, root in (request.roots or {}).items():
        found += _recorded(name, root, plan, request)
    return found


def _world(name: str, plan: Plan, request: Request) -> Study:
    overrides = plan.quick.get(name, []) if request.quick else []
    path = folder_of_configs() / f"{name}.yaml"
    tree = read_yaml(path)
    runs = compose(tree, overrides, path)
    if name == "flow":
        runs += _ablations(tree, overrides, request.ablation)
    return Study(name, WORLD, "Embedded world", tuple(runs))


def _recorded(name: str, root: Path, plan: Plan, request: Request) -> list[Study]:
    recorded = plan.recorded[name]
    dataset = {**recorded.dataset, "root": str(root)}
    detections = (request.detections or {}).get(name)
    if detections is not None:
        dataset["detections"] = str(detections)
    overrides = list(recorded.quick) if request.quick else []
    limit = recorded.quick_scenes if request.quick else recorded.scenes
    has_boxes = name == "kitti" or detections is not None
    made: list[Study] = []
    usable: tuple[str, ...] = ()
    left_out: dict[str, str] = {}
    for study in STUDIES if has_boxes else ("flow", "velocity"):
        path = folder_of_configs() / f"{study}.yaml"
        tree = {**read_yaml(path), "dataset": dataset}
        if not has_boxes:
            tree["flow"] = [flow for flow in tree["flow"] if flow not in NEEDS_DETECTIONS]
            tree["objects"] = "clusters"  # flow is scored on cells; what is tracked does not matter
        runs = compose(tree, overrides, path)
        if study == "flow":
            runs += _ablations(tree, overrides, request.ablation)
        if not made:
            usable, left_out = usable_scenes(runs[0])
        chosen = tuple(_only(run, _spread(usable, limit)) for run in runs)
        made.append(Study(study, name, recorded.title, chosen, left_out))
    return made


def usable_scenes(run: Experiment) -> tuple[tuple[str, ...], dict[str, str]]:
    """The scenes of a data set that have frames to pair, and why the others have not.

    Raises:
        ConfigError: there is none.
    """
    dataset = run.dataset.make()
    usable, left_out = [], {}
    for name in scene_names(run):
        try:
            frames = len(dataset.scene(name))
        except DataError as error:
            left_out[name] = str(error)
            continue
        if frames > 1:
            usable.append(name)
        else:
            left_out[name] = f"{frames} frame: no pair of sweeps"
    if not usable:
        raise ConfigError(f"no scene can be used: {next(iter(left_out.values()), 'there is none')}")
    return tuple(usable), left_out


def _ablations(
    tree: Mapping[str, Any], overrides: Sequence[str], folder: Path | None
) -> list[Experiment]:
    path = folder_of_configs() / "flow.yaml"
    found = []
    for name in ABLATIONS:
        weights = ablation_weights(name, folder)
        if weights is None:
            continue
        flow: dict[str, Any] = {"kind": "pillarflow", "weights": weights, "refined": False}
        if name == "with_ground":
            flow["stages"] = {"ground": {"enabled": False}}
        run = compose({**tree, "flow": flow}, overrides, path)[0]
        found.append(replace(run, variant=name))
    return found


def ablation_weights(name: str, folder: Path | None) -> str | None:
    """Weights of a row of Table II: from the folder, else shipped ones, else None."""
    if folder is not None and (folder / name / "weights.safetensors").is_file():
        return str(folder / name / "weights.safetensors")
    return name if (SHIPPED / f"{name}.safetensors").is_file() else None


def _only(run: Experiment, scenes: tuple[str, ...]) -> Experiment:
    return replace(run, settings=run.settings.model_copy(update={"scenes": scenes}))


def _spread(scenes: Sequence[str], limit: int) -> tuple[str, ...]:
    """At most so many of the scenes, evenly spread."""
    if len(scenes) <= limit:
        return tuple(scenes)
    index = np.linspace(0, len(scenes) - 1, limit).round().astype(int)
    return tuple(scenes[i] for i in index)
