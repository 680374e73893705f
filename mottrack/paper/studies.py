"""The studies of a request: on the embedded world, and on what recorded data sets can serve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mottrack.core.errors import ConfigError, DataError
from mottrack.experiment.experiment import Experiment, compose
from mottrack.formats.yaml_file import read_yaml
from mottrack.paper.plan import (
    STUDIES,
    WORLD,
    Plan,
    RecordedPlan,
    Request,
    Study,
    ablation_runs,
    config_file,
    read_plan,
)
from mottrack.paper.published import ICP, NONE
from mottrack.runs.runner import scene_names

REGISTRATION = (ICP, "icp")
"""Variants that register detected objects."""
TRACKING = "tracking"
"""Begin of the names of the studies of Table III, which need detections and nothing else."""
MIN_FRAMES = 2
"""Flow and velocity need a pair of frames."""
NO_PAIRS = "no scene has a sweep in every frame"
NO_BOXES = "no scene has detections; set {name}.detections=FILE"
NO_SWEEPS = "needs sweeps, which no scene with detections has"
NO_DETECTIONS = "registers detected objects, and no scene with sweeps has detections"


@dataclass(frozen=True)
class DatasetCapabilities:
    """Which scenes of a data set have sweeps and detections."""

    swept: tuple[str, ...]
    """Scenes of at least two frames with a sweep in each."""
    detected: tuple[str, ...]
    """Scenes of at least two frames with detections."""
    left_out: dict[str, str]
    """All other scenes to the reason."""

    @property
    def both(self) -> tuple[str, ...]:
        """Scenes with sweeps and detections."""
        return tuple(scene for scene in self.swept if scene in self.detected)


@dataclass(frozen=True)
class _Share:
    """What a data set contributes to one study."""

    scenes: tuple[str, ...]
    absent: dict[str, str] = field(default_factory=dict)
    """Variants that can't be run to the reason."""
    reason: str = ""
    """Why there are no scenes."""


@dataclass(frozen=True)
class _Source:
    """A recorded data set that takes part."""

    name: str
    plan: RecordedPlan
    dataset: dict[str, Any]
    overrides: list[str]
    capabilities: DatasetCapabilities


def studies(request: Request) -> list[Study]:
    """Return every study that is asked for; one that a data set can't serve has a reason.

    Raises:
        ConfigError: a setting is wrong, or a data set has no usable scene.
        DataError: a data set is not where it is said to be.
    """
    plan = read_plan()
    settings = _settings(plan, request)
    found = [_world(name, plan, request) for name in (*STUDIES, "ball", "runtime")]
    for name in request.roots:
        source = _opened(name, plan.recorded[name], request, settings[name])
        found += [_recorded(study, source, request) for study in STUDIES]
    return found


def _settings(plan: Plan, request: Request) -> dict[str, list[str]]:
    """Return the user's overrides by data set, without the name of the data set."""
    found: dict[str, list[str]] = {name: [] for name in request.roots}
    for setting in request.settings:
        name, _, rest = setting.partition(".")
        if name not in plan.recorded:
            expected = f"NAME.key=value with NAME one of {sorted(plan.recorded)}"
            raise ConfigError(f"setting '{setting}' belongs to no data set, expected {expected}")
        if name not in found:
            raise ConfigError(f"setting '{setting}' needs the data set's folder: --{name} FOLDER")
        found[name].append(rest)
    return found


def _world(name: str, plan: Plan, request: Request) -> Study:
    overrides = plan.quick.get(name, []) if request.quick else []
    tree = read_yaml(config_file(name))
    runs = compose(tree, overrides, config_file(name))
    if name == "flow":
        runs += ablation_runs(tree, overrides, request.ablation)
    return Study(name, WORLD, "Embedded world", tuple(runs))


def _opened(name: str, plan: RecordedPlan, request: Request, settings: Sequence[str]) -> _Source:
    """Open a data set, restricted to frames with sweeps if it has any.

    Raises:
        ConfigError: no scene can be used.
    """
    overrides = [*(plan.quick if request.quick else ()), *(f"dataset.{rest}" for rest in settings)]
    dataset = {**plan.dataset, "root": str(request.roots[name])}
    tries = [{**dataset, **plan.with_sweeps}, dataset] if plan.with_sweeps else [dataset]
    for tried in tries:
        source = _Source(name, plan, tried, overrides, _capabilities(tried, overrides))
        if source.capabilities.swept:
            return source
    if not source.capabilities.detected:
        reason = next(iter(source.capabilities.left_out.values()), "there is none")
        raise ConfigError(f"{name}: no scene can be used: {reason}")
    return source


def _capabilities(dataset: dict[str, Any], overrides: Sequence[str]) -> DatasetCapabilities:
    """Open every scene to see what it has."""
    run = compose({"dataset": dataset}, overrides, config_file("plan"))[0]
    data, swept, detected = run.dataset.make(), [], []
    left_out: dict[str, str] = {}
    for name in scene_names(run):
        try:
            scene = data.scene(name)
            frames, has_sweeps = len(scene), scene.has_sweeps
            has_boxes = frames > 0 and scene.frame(0).detections is not None
        except DataError as error:
            left_out[name] = str(error)
            continue
        if frames < MIN_FRAMES:
            left_out[name] = f"{frames} frame, expected at least {MIN_FRAMES}"
            continue
        if has_sweeps:
            swept.append(name)
        if has_boxes:
            detected.append(name)
        if not has_sweeps and not has_boxes:
            left_out[name] = "neither detections nor a sweep in every frame"
    return DatasetCapabilities(tuple(swept), tuple(detected), left_out)


def _recorded(name: str, source: _Source, request: Request) -> Study:
    tree = {**read_yaml(config_file(name)), "dataset": source.dataset}
    share = _share(name, source, tree["flow"])
    if not share.scenes:
        return Study(name, source.name, source.plan.title, (), reason=share.reason)
    tree["flow"] = [flow for flow in tree["flow"] if flow not in share.absent]
    if not name.startswith(TRACKING) and not source.capabilities.both:
        tree["objects"] = "clusters"
    runs = compose(tree, source.overrides, config_file(name))
    if len(runs) == 1:
        runs = [replace(runs[0], variant=tree["flow"][0])]  # a single run has no variant name
    if name == "flow":
        runs += ablation_runs(tree, source.overrides, request.ablation)
    limit = source.plan.quick_scenes if request.quick else source.plan.scenes
    scenes = spread(share.scenes, limit)
    chosen = tuple(_restricted(run, scenes) for run in runs)
    left_out = source.capabilities.left_out
    return Study(name, source.name, source.plan.title, chosen, left_out, share.absent)


def _share(study: str, source: _Source, flows: Sequence[str]) -> _Share:
    scenes = source.capabilities
    if scenes.both:
        return _Share(scenes.both)
    if study.startswith(TRACKING):
        without = {flow: NO_SWEEPS for flow in flows if flow != NONE}
        return _Share(scenes.detected, without, NO_BOXES.format(name=source.name))
    if study == "flow":
        without = {flow: NO_DETECTIONS for flow in flows if flow in REGISTRATION}
        return _Share(scenes.swept, without, NO_PAIRS)
    return _Share(scenes.swept, reason=NO_PAIRS)


def _restricted(run: Experiment, scenes: tuple[str, ...]) -> Experiment:
    return replace(run, settings=run.settings.model_copy(update={"scenes": scenes}))


def spread(scenes: Sequence[str], limit: int) -> tuple[str, ...]:
    """Select at most ``limit`` scenes, evenly spread."""
    if len(scenes) <= limit:
        return tuple(scenes)
    index = np.linspace(0, len(scenes) - 1, limit).round().astype(int)
    return tuple(scenes[i] for i in index)
