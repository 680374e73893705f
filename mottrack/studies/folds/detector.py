"""Detector model and noise of the other folds, held against counts on the fold left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, Mask
from mottrack.core.errors import ConfigError, InputError
from mottrack.experiment.plugins import Part
from mottrack.studies.consistency import (
    NEES_STATE,
    NEES_VELOCITY,
    NIS_XY,
    Errors,
    joined,
    measure,
)
from mottrack.studies.detector_model import LEAST_BOXES, ClassCounts, count, fit_scores
from mottrack.studies.folds.groups import RecordedGroup
from mottrack.studies.tracker_noise import estimate
from mottrack.studies.tuning.recorded import RecordedScene
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.tracker import KalmanTracker
from mottrack.trackers.noise_estimation.consistency import Consistency

CLASSES = ("car", "pedestrian", "cyclist")
"""Of which consistency is shown: the others have too few objects to say anything."""
NOISES = {"errors of the other folds": False, "innovations of the other folds": True}
"""Name to whether the noise is scaled to the innovations (`estimate`)."""
SMALLEST = 1e-6
"""Probabilities are kept from 0 and 1 in the log loss."""


class Fold(NamedTuple):
    """Scenes that are left out, and the others of the group."""

    others: list[RecordedScene]
    own: list[RecordedScene]


class DetectorRow(NamedTuple):
    """Estimates of one class against what is counted where they took no part."""

    group: str
    label: str
    counted: ClassCounts
    p_estimated: float
    """Probability of detection after a detection, of the other folds."""
    clutter_estimated: float
    """Per m^2, by the tracker itself at the end of each scene, mean over scenes."""
    loss_constant: float
    """Mean log loss of the share of true detections of the other folds, in nats."""
    loss_calibrated: float
    """Of scores calibrated on the other folds."""


class ConsistencyRow(NamedTuple):
    """Honesty of the covariances of one class where the noise took no part."""

    group: str
    label: str
    noise: str
    position: Consistency
    state: Consistency
    velocity: Consistency


def folds_of(group: RecordedGroup, fold_of: dict[str, int]) -> Iterator[Fold]:
    """Yield the folds of a group that leave some scenes on either side."""
    for fold in sorted({fold_of[name] for name in group.names}):
        inside = {name: fold_of[name] == fold for name in group.names}
        others = [group.scenes[name] for name in group.names if not inside[name]]
        if others:
            yield Fold(others, [group.scenes[name] for name in group.names if inside[name]])


def kalman_config(tracker: Part) -> KalmanConfig:
    """Return the settings of a Kalman tracker.

    Raises:
        ConfigError: it is another tracker.
    """
    if not isinstance(tracker.config, KalmanConfig):
        raise ConfigError(f"tracker is '{tracker.kind}', expected kalman for `detector`")
    return tracker.config


def detector_rows(
    group: RecordedGroup, folds: Sequence[Fold], config: KalmanConfig
) -> list[DetectorRow]:
    """Return a row for each class with enough boxes."""
    counted = count(group.scenes.values())
    clutter = _clutter(group, config)
    by_fold = [(count(fold.others, least=1), count(fold.own, least=1)) for fold in folds]
    rows = []
    for label, whole in counted.items():
        if not len(whole.scores):
            continue  # the detector does not know the class
        pairs = [(a[label], b[label]) for a, b in by_fold if label in a and label in b]
        p = sum(a.after_detection.share * b.after_detection.boxes for a, b in pairs)
        boxes = sum(b.after_detection.boxes for _, b in pairs)
        constant, calibrated = _losses(pairs)
        density = clutter.get(label, float("nan"))
        estimated = p / boxes if boxes else float("nan")
        rows.append(
            DetectorRow(group.group.name, label, whole, estimated, density, constant, calibrated)
        )
    return rows


def _clutter(group: RecordedGroup, config: KalmanConfig) -> dict[str, float]:
    """Return the density that the tracker estimates by the end of a scene, mean over scenes."""
    found: dict[str, list[float]] = {}
    for scene in group.scenes.values():
        tracker = KalmanTracker(config)
        for objects in scene.objects:
            tracker.step(objects.stamp_ns, objects)
        for label, density in tracker.clutter_per_m2().items():
            found.setdefault(label, []).append(density)
    return {label: float(np.mean(values)) for label, values in found.items()}


class _Losses(NamedTuple):
    constant: float
    calibrated: float


def _losses(pairs: Sequence[tuple[ClassCounts, ClassCounts]]) -> _Losses:
    constant, calibrated = [np.empty(0)], [np.empty(0)]
    for others, own in pairs:
        if others.true.any() and len(own.true):
            share = np.full(len(own.true), others.true.mean())
            constant.append(_log_loss(share, own.true))
            calibrated.append(_log_loss(fit_scores(others).probability(own.scores), own.true))
    first, second = (np.concatenate(parts) for parts in (constant, calibrated))
    if not len(first):
        return _Losses(float("nan"), float("nan"))
    return _Losses(float(first.mean()), float(second.mean()))


def _log_loss(p: F64, true: Mask) -> F64:
    likely = np.clip(np.where(true, p, 1.0 - p), SMALLEST, 1.0)
    loss: F64 = -np.log(likely)
    return loss


def consistency_rows(
    group: RecordedGroup, folds: Sequence[Fold], config: KalmanConfig
) -> list[ConsistencyRow]:
    """Return rows for the default noise and for that of the other folds, over all folds."""
    kinds: dict[str, list[Errors]] = {name: [] for name in ("default", *NOISES)}
    for fold in folds:
        kinds["default"].append(measure(fold.own, config))
        for name, innovations in NOISES.items():
            try:
                settings = estimate(fold.others, config, innovations=innovations).settings
            except InputError:  # too few boxes of every class
                continue
            kinds[name].append(measure(fold.own, KalmanConfig.model_validate(settings)))
    rows = []
    for label in CLASSES:
        for kind, parts in kinds.items():
            found = joined(parts).summary(label)
            if found[NIS_XY].count >= LEAST_BOXES:
                three = (found[name] for name in (NIS_XY, NEES_STATE, NEES_VELOCITY))
                rows.append(ConsistencyRow(group.group.name, label, kind, *three))
    return rows
