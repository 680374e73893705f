"""Calibrate how a flow source's velocities of objects err, on scenes with truth."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mottrack.core.errors import DataError, InputError
from mottrack.core.objects import Objects, Truth
from mottrack.core.storage import write_text
from mottrack.core.velocity_errors import VelocityErrorModel, read_error_models
from mottrack.experiment.experiment import Experiment
from mottrack.studies.tuning.recorded import OnScene, record
from mottrack.trackers.noise_estimation.error_model import VelocitySample, fit_error_model
from mottrack.trackers.noise_estimation.samples import match_truth

SCENE_IDS = 2**40
"""Identities are counted or hashed to 32 bits: those of different scenes stay apart."""


@dataclass(frozen=True)
class ErrorStudy:
    """The fitted error model of a source and what it rests on."""

    name: str
    """Under which the source looks itself up; its kind in a configuration otherwise."""
    model: VelocityErrorModel
    velocities: int
    moving: int
    consistency: float
    """Mean normalised square of the errors under the stated covariance; 1 is consistent."""


def study_errors(experiment: Experiment, on_scene: OnScene = lambda *_: None) -> ErrorStudy:
    """Fit the error model of an experiment's flow source over all its scenes.

    Raises:
        InputError: too few velocities were measured.
        DataError: no frame has truth.
    """
    scenes = record(experiment, on_scene)
    parts = [
        part
        for k, scene in enumerate(scenes)
        for frame in scene.truth_frames()
        if (part := _sample(*frame, first=k * SCENE_IDS))
    ]
    if not parts:
        raise DataError(
            Path(scenes[0].result.name),
            f"velocities that {experiment.flow.kind} measured of objects with truth",
            "0",
            "some in one of the scenes",
        )
    sample = VelocitySample.stacked(parts)
    source = experiment.flow.make(grid=experiment.settings.grid.grid())
    key = getattr(source, "errors_name", experiment.flow.kind)
    moving = int((np.hypot(*sample.true_mps.T) > 1.0).sum())
    try:
        model = fit_error_model(sample)
    except InputError as error:
        expected = f"{error.expected}: more or longer scenes"
        raise InputError(f"{error.field} of {key}", error.value, expected) from error
    return ErrorStudy(key, model, len(sample.label), moving, sample.consistency)


def store(study: ErrorStudy, file: Path) -> None:
    """Add the model to a file, or replace the one of its name, atomically."""
    models = read_error_models(file) if file.exists() else {}
    models[study.name] = study.model
    content = {name: models[name].as_dict() for name in sorted(models)}
    write_text(file, json.dumps(content, indent=1) + "\n")


def _sample(objects: Objects, truth: Truth, *, first: int) -> VelocitySample | None:
    """Return the measured velocities of detections that match an object of known velocity.

    `first` is added to the identities, which are unique within a scene alone.
    """
    measured = objects.velocity
    if measured is None:
        return None
    i, j = match_truth(objects, truth)
    known = measured.valid[i] & np.isfinite(truth.velocity_mps[j]).all(axis=1)
    i, j = i[known], j[known]
    return VelocitySample(
        truth.label[j],
        measured.mean_mps[i],
        measured.covariance_m2ps2[i],
        truth.velocity_mps[j],
        first + truth.id[j],
    )
