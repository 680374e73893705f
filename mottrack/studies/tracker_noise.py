"""Estimate the noise of the Kalman tracker from an experiment's data, and test its consistency."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.errors import ConfigError
from mottrack.core.interfaces import Scene
from mottrack.core.objects import Objects, Tracks, Truth
from mottrack.experiment.experiment import Experiment
from mottrack.pipeline.stream import Pipeline
from mottrack.runs.runner import scene_names
from mottrack.trackers.kalman.config import KalmanConfig, merged
from mottrack.trackers.kalman.tracker import KalmanTracker
from mottrack.trackers.noise_estimation.consistency import Consistency, consistency, nees
from mottrack.trackers.noise_estimation.estimate import (
    ClassEstimate,
    VelocityEstimate,
    estimate_noise,
    estimate_velocity_noise,
)
from mottrack.trackers.noise_estimation.samples import SampleCollector

OnScene = Callable[[str, int, int], None]


@dataclass(frozen=True)
class NoiseStudy:
    """Estimated noise of a tracker, and how consistent the filter is without and with it."""

    classes: dict[str, ClassEstimate]
    """P0, Q and R of each class."""
    velocity: VelocityEstimate | None
    """R_d of the flow source; None if it measures no velocities."""
    settings: dict[str, object]
    """Of the tracker, with the estimated noise: a value for `tracker` in a configuration."""
    before: dict[str, Consistency]
    """NIS and NEES with the noise of the experiment."""
    after: dict[str, Consistency]
    """NIS and NEES with the estimated noise."""


class TruthFrame(NamedTuple):
    """Input of the tracker at a key frame, with its truth."""

    objects: Objects
    truth: Truth


@dataclass
class _InputRecorder:
    """Takes the tracker's place in the pipeline and keeps its last input."""

    objects: Objects | None = None

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Keep the objects; return no tracks."""
        self.objects = objects
        return Tracks.empty(stamp_ns)


def study_noise(experiment: Experiment, on_scene: OnScene = lambda *_: None) -> NoiseStudy:
    """Estimate R, P0, Q by class and R_d of the flow source, over all scenes of an experiment.

    Args:
        experiment: its tracker is the Kalman tracker.
        on_scene: is called with (name, done, total) after each scene.

    Raises:
        ConfigError: the tracker is not the Kalman tracker.
        InputError: there is too little truth to estimate from.
    """
    config = experiment.tracker.config
    if not isinstance(config, KalmanConfig):
        raise ConfigError(f"tracker is '{experiment.tracker.kind}', expected kalman")
    dataset, names = experiment.dataset.make(), scene_names(experiment)
    collector, scenes = SampleCollector(), []
    for k, name in enumerate(names):
        frames = list(_truth_frames(experiment, dataset.scene(name)))
        for objects, truth in frames:
            collector.add(name, objects, truth)
        scenes.append(frames)
        on_scene(name, k + 1, len(names))
    pairs = collector.samples()
    classes, velocity = estimate_noise(pairs), estimate_velocity_noise(pairs)
    settings = _settings(classes, velocity, config)
    before, after = (
        _consistency(scenes, one) for one in (config, KalmanConfig.model_validate(settings))
    )
    return NoiseStudy(classes, velocity, settings, before, after)


def _truth_frames(experiment: Experiment, scene: Scene) -> Iterator[TruthFrame]:
    """Yield the tracker's input at each key frame that has truth."""
    pipeline, recorder = Pipeline(experiment), _InputRecorder()
    pipeline.tracker = recorder
    for index in range(len(scene)):
        frame = scene.frame(index)
        pipeline.step(frame, scene.sweep(index) if pipeline.needs_sweeps else None)
        if frame.is_key and frame.truth is not None and recorder.objects is not None:
            yield TruthFrame(recorder.objects, frame.truth)


def _settings(
    classes: dict[str, ClassEstimate], velocity: VelocityEstimate | None, config: KalmanConfig
) -> dict[str, object]:
    noise = {label: c.noise.model_dump(exclude_defaults=True) for label, c in classes.items()}
    changes: dict[str, object] = {"noise": {"classes": noise, "form": "wiener"}, "time": "seconds"}
    if velocity is not None:
        v = velocity.variance_m2ps2
        changes["velocity"] = {"covariance": (v, 0.0, v)}
    return merged(config.model_dump(exclude_unset=True), changes)


def _consistency(scenes: list[list[TruthFrame]], config: KalmanConfig) -> dict[str, Consistency]:
    """Run the tracker over all scenes and test NIS and NEES; nothing for noise per frame."""
    if config.time == "frames":
        return {}
    errors, innovations = [np.empty(0)], [np.empty(0)]
    for frames in scenes:
        tracker = KalmanTracker(config.model_copy(update={"diagnose": True}))
        for objects, truth in frames:
            tracks = tracker.step(objects.stamp_ns, objects)
            innovations.append(tracker.nis)
            errors.append(nees(tracks, truth))
    return {
        "NIS of the box": consistency(np.concatenate(innovations), 7),
        "NEES of x, y, d_x, d_y": consistency(np.concatenate(errors), 4),
    }
