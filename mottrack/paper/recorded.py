"""How a recorded data set enters the studies: with the scenes and the runs that it can serve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mottrack.core.errors import ConfigError, DataError
from mottrack.experiment.experiment import Experiment, compose
from mottrack.experiment.yaml_file import read_yaml
from mottrack.paper.ablations import ablation_runs
from mottrack.paper.plan import STUDIES, RecordedPlan, Request, Study, config_file
from mottrack.paper.published import ICP, NONE
from mottrack.runs.runner import scene_names

REGISTRATION = (ICP, "icp")
"""Variants that register what a detector found."""
LEAST_FRAMES = 2
NO_PAIRS = "no scene has a sweep in every frame"
NO_BOXES = "no scene has detections; where they are is said by {name}.detections="
NO_SWEEPS = "needs sweeps, which no scene with detections has"
NO_DETECTIONS = "registers detected objects, and no scene with sweeps has detections"


@dataclass(frozen=True)
class DatasetCapabilities:
    """What the scenes of a data set can serve for."""

    swept: tuple[str, ...]
    """Scenes of two frames or more that have a sweep in each."""
    detected: tuple[str, ...]
    """Scenes of two frames or more with detections."""
    left_out: dict[str, str]
    """The others, and why."""

    @property
    def both(self) -> tuple[str, ...]:
        """Scenes with sweeps and detections."""
        return tuple(scene for scene in self.swept if scene in self.detected)


@dataclass(frozen=True)
class _Share:
    """What a data set gives to one study."""

    scenes: tuple[str, ...]
    absent: dict[str, str] = field(default_factory=dict)
    """Variants that can't be run, and why."""
    reason: str = ""
    """What to say where there are no scenes."""


@dataclass(frozen=True)
class _Source:
    """A data set that takes part."""

    name: str
    dataset: dict[str, Any]
    overrides: list[str]
    offer: DatasetCapabilities


def recorded_studies(name: str, recorded: RecordedPlan, request: Request) -> list[Study]:
    """The studies of a data set; one that it can't serve has a reason in place of runs.

    Raises:
        ConfigError: a setting is wrong, or no scene can be used.
        DataError: the data set is not where it is said to be.
    """
    source = _opened(name, recorded, request)
    return [_study(study, source, recorded, request) for study in STUDIES]


def _opened(name: str, recorded: RecordedPlan, request: Request) -> _Source:
    """With frames that have sweeps alone where there are any, else with all."""
    overrides = list(recorded.quick) if request.quick else []
    mine = [setting for setting in request.settings if setting.startswith(f"{name}.")]
    overrides += [f"dataset{setting.removeprefix(name)}" for setting in mine]
    dataset = {**recorded.dataset, "root": str((request.roots or {})[name])}
    tries = [{**dataset, **recorded.with_sweeps}, dataset] if recorded.with_sweeps else [dataset]
    for settings in tries:
        source = _Source(name, settings, overrides, _offer(settings, overrides))
        if source.offer.swept:
            return source
    if not source.offer.detected:
        reason = next(iter(source.offer.left_out.values()), "there is none")
        raise ConfigError(f"{name}: no scene can be used: {reason}")
    return source


def _offer(dataset: dict[str, Any], overrides: Sequence[str]) -> DatasetCapabilities:
    """Opens every scene to see what is there."""
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
        if frames < LEAST_FRAMES:
            left_out[name] = f"{frames} frame: nothing to pair it with"
            continue
        if has_sweeps:
            swept.append(name)
        if has_boxes:
            detected.append(name)
        if not has_sweeps and not has_boxes:
            left_out[name] = "neither detections nor a sweep in every frame"
    return DatasetCapabilities(tuple(swept), tuple(detected), left_out)


def _study(name: str, source: _Source, recorded: RecordedPlan, request: Request) -> Study:
    tree = {**read_yaml(config_file(name)), "dataset": source.dataset}
    share = _share(name, source, tree["flow"])
    if not share.scenes:
        return Study(name, source.name, recorded.title, (), reason=share.reason)
    tree["flow"] = [flow for flow in tree["flow"] if flow not in share.absent]
    if not source.offer.both:
        tree["objects"] = tree["objects"] if name == "tracking" else "clusters"
    runs = compose(tree, source.overrides, config_file(name))
    if len(runs) == 1:
        runs = [replace(runs[0], variant=tree["flow"][0])]  # one run alone has no name
    if name == "flow":
        runs += ablation_runs(tree, source.overrides, request.ablation)
    limit = recorded.quick_scenes if request.quick else recorded.scenes
    scenes = spread(share.scenes, limit)
    chosen = tuple(_only(run, scenes) for run in runs)
    left_out = source.offer.left_out
    return Study(name, source.name, recorded.title, chosen, left_out, share.absent)


def _share(study: str, source: _Source, flows: Sequence[str]) -> _Share:
    offer = source.offer
    if offer.both:
        return _Share(offer.both)
    if study == "tracking":
        without = {flow: NO_SWEEPS for flow in flows if flow != NONE}
        return _Share(offer.detected, without, NO_BOXES.format(name=source.name))
    if study == "flow":
        without = {flow: NO_DETECTIONS for flow in flows if flow in REGISTRATION}
        return _Share(offer.swept, without, NO_PAIRS)
    return _Share(offer.swept, reason=NO_PAIRS)


def _only(run: Experiment, scenes: tuple[str, ...]) -> Experiment:
    return replace(run, settings=run.settings.model_copy(update={"scenes": scenes}))


def spread(scenes: Sequence[str], limit: int) -> tuple[str, ...]:
    """At most so many of the scenes, evenly spread."""
    if len(scenes) <= limit:
        return tuple(scenes)
    index = np.linspace(0, len(scenes) - 1, limit).round().astype(int)
    return tuple(scenes[i] for i in index)
