"""Estimate the noise of the Kalman tracker from an experiment's data, and test its consistency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from mottrack.core.errors import ConfigError
from mottrack.experiment.experiment import Experiment
from mottrack.studies.consistency import NIS_XY, Errors, measure
from mottrack.studies.detector_model import ClassCounts, count
from mottrack.studies.tuning.recorded import OnScene, RecordedScene, record
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.presets import merged
from mottrack.trackers.noise_estimation.consistency import Consistency
from mottrack.trackers.noise_estimation.estimate import (
    ClassEstimate,
    VelocityEstimate,
    estimate_noise,
    estimate_velocity_noise,
)
from mottrack.trackers.noise_estimation.samples import SampleCollector

LEAST_INNOVATIONS = 100
"""Of a class whose noise is scaled: the mean of fewer squares is off by more than a seventh."""
PLANAR = (0, 1, 7, 8)
"""x, y, d_x, d_y in the tables of the noise."""


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
    detector: dict[str, ClassCounts]
    """What the detector finds and invents, by class."""


class Estimated(NamedTuple):
    """Noise from scenes with truth."""

    classes: dict[str, ClassEstimate]
    velocity: VelocityEstimate | None
    settings: dict[str, object]


def study_noise(
    experiment: Experiment, on_scene: OnScene = lambda *_: None, *, innovations: bool = False
) -> NoiseStudy:
    """Estimate R, P0, Q by class and R_d of the flow source, over all scenes of an experiment.

    Args:
        experiment: its tracker is the Kalman tracker.
        on_scene: is called with (name, done, total) after each scene.
        innovations: scale the noise to the innovations (`estimate`).

    Raises:
        ConfigError: the tracker is not the Kalman tracker.
        InputError: there is too little truth to estimate from.
    """
    config = experiment.tracker.config
    if not isinstance(config, KalmanConfig):
        raise ConfigError(f"tracker is '{experiment.tracker.kind}', expected kalman")
    scenes = record(experiment, on_scene)
    found = estimate(scenes, config, innovations=innovations)
    before, after = (
        # noise per frame has no law in seconds
        {} if one.time == "frames" else measure(scenes, one).summary()
        for one in (config, KalmanConfig.model_validate(found.settings))
    )
    return NoiseStudy(*found, before, after, count(scenes))


def estimate(
    scenes: Sequence[RecordedScene], config: KalmanConfig, *, innovations: bool = False
) -> Estimated:
    """Estimate the noise over scenes; the settings are `config` with it.

    A detector's errors last: a box is drawn too far ahead frame after frame, and the vehicle's pose
    errs slowly. They are in the differences to the truth and not in those from step to step, so
    with the noise of the former the innovations are smaller than stated. With `innovations` the
    variances of x and y are scaled by class to the mean square of the innovations (covariance
    matching; Mehra, 1972): the gate is then as wide as it says, the gains, which depend on ratios
    of variances, are the same, and the published covariance leaves out what lasts.

    Raises:
        InputError: there is too little truth to estimate from.
    """
    collector = SampleCollector()
    for scene in scenes:
        for objects, truth in scene.truth_frames():
            collector.add(scene.result.name, objects, truth)
    pairs = collector.samples()
    classes, velocity = estimate_noise(pairs), estimate_velocity_noise(pairs)
    if innovations:
        errors = measure(scenes, KalmanConfig.model_validate(_settings(classes, velocity, config)))
        classes = {label: _scaled(one, errors, label) for label, one in classes.items()}
    return Estimated(classes, velocity, _settings(classes, velocity, config))


def _scaled(estimate: ClassEstimate, errors: Errors, label: str) -> ClassEstimate:
    found = errors.summary(label)[NIS_XY]
    if found.count < LEAST_INNOVATIONS:
        return estimate
    noise, factor = estimate.noise, found.mean_ratio
    tables = {
        name: tuple(
            value * (factor if k in PLANAR else 1.0) for k, value in enumerate(getattr(noise, name))
        )
        for name in ("observation", "initial", "process")
    }
    return replace(estimate, noise=noise.model_copy(update=tables))


def _settings(
    classes: dict[str, ClassEstimate], velocity: VelocityEstimate | None, config: KalmanConfig
) -> dict[str, object]:
    noise = {label: c.noise.model_dump(exclude_defaults=True) for label, c in classes.items()}
    changes: dict[str, object] = {"noise": {"classes": noise, "form": "wiener"}, "time": "seconds"}
    if velocity is not None:
        known = velocity.class_variance_m2ps2 | {"all": velocity.variance_m2ps2}
        changes["velocity"] = {"noise": "class", "class_variance": known}
    return merged(config.model_dump(exclude_unset=True), changes)
