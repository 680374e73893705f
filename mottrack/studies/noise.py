"""What the noise of a tracker should be: an experiment's data, gathered and judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

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
SceneFrames = list[tuple[Objects, Truth]]


@dataclass(frozen=True)
class NoiseStudy:
    """The noise that an experiment's data ask for, and how honest the filter is with it."""

    classes: dict[str, ClassEstimate]
    velocity: VelocityEstimate | None
    settings: dict[str, object]
    """Of the tracker, with the estimated noise: what `tracker: ...` in a config may be."""
    before: dict[str, Consistency]
    """NIS and NEES with the noise the experiment had."""
    after: dict[str, Consistency]
    """NIS and NEES with the estimated noise."""


@dataclass
class _Listener:
    """Stands in for the tracker and keeps what it is shown."""

    heard: list[Objects] = field(default_factory=list)

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Keeps the objects; tracks nothing."""
        self.heard.append(objects)
        return Tracks.empty(stamp_ns)


def study_noise(experiment: Experiment, on_scene: OnScene = lambda *_: None) -> NoiseStudy:
    """Estimates R, P0, Q by class and R_d of the flow source, over all scenes of an experiment.

    Raises:
        ConfigError: the tracker is not the Kalman tracker.
        InputError: there is too little truth to learn from.
    """
    config = experiment.tracker.config
    if not isinstance(config, KalmanConfig):
        raise ConfigError(f"tracker is '{experiment.tracker.kind}', expected kalman")
    dataset, names = experiment.dataset.make(), scene_names(experiment)
    collector, scenes = SampleCollector(), []
    for k, name in enumerate(names):
        frames = list(_frames(experiment, dataset.scene(name)))
        for objects, truth in frames:
            collector.add(name, objects, truth)
        scenes.append(frames)
        on_scene(name, k + 1, len(names))
    pairs = collector.samples()
    classes, velocity = estimate_noise(pairs), estimate_velocity_noise(pairs)
    settings = _settings(classes, velocity, config)
    estimated = KalmanConfig.model_validate(settings)
    return NoiseStudy(
        classes, velocity, settings, _honesty(scenes, config), _honesty(scenes, estimated)
    )


def _frames(experiment: Experiment, scene: Scene) -> Iterator[tuple[Objects, Truth]]:
    """What the tracker would be shown at each key frame that has truth, and that truth."""
    listener = _Listener()
    pipeline = Pipeline(experiment)
    pipeline.tracker = listener
    for index in range(len(scene)):
        frame = scene.frame(index)
        pipeline.step(frame, scene.sweep(index) if pipeline.needs_sweeps else None)
        if frame.is_key and frame.truth is not None:
            yield listener.heard[-1], frame.truth


def _settings(
    classes: dict[str, ClassEstimate], velocity: VelocityEstimate | None, config: KalmanConfig
) -> dict[str, object]:
    noise = {label: c.noise.model_dump(exclude_defaults=True) for label, c in classes.items()}
    changes: dict[str, object] = {"noise": {"classes": noise, "form": "wiener"}, "time": "seconds"}
    if velocity is not None:
        v = velocity.variance_m2ps2
        changes["velocity"] = {"covariance": (v, 0.0, v)}
    return merged(config.model_dump(exclude_unset=True), changes)


def _honesty(scenes: list[SceneFrames], config: KalmanConfig) -> dict[str, Consistency]:
    if config.time == "frames":
        return {}
    errors, surprises = [np.empty(0)], [np.empty(0)]
    for frames in scenes:
        tracker = KalmanTracker(config.model_copy(update={"diagnose": True}))
        for objects, truth in frames:
            tracks = tracker.step(objects.stamp_ns, objects)
            surprises.append(tracker.nis)
            errors.append(nees(tracks, truth))
    return {
        "NIS of the box": consistency(np.concatenate(surprises), 7),
        "NEES of x, y, d_x, d_y": consistency(np.concatenate(errors), 4),
    }
