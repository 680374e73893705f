"""Training pairs of the embedded world in the form in which the flow network learns from them."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import ValidationError

from mottrack.core.arrays import F32, I16, I64
from mottrack.core.errors import ConfigError
from mottrack.core.sweep import seconds_between
from mottrack.experiment.validation_message import format_validation_error
from mottrack.flow.pillarflow.training.example import Labels
from mottrack.flow.pillarflow.training.making import LabelledPair
from mottrack.world import TrainingConfig, TrainingPair, training_pair


def world_pair(seed: int, index: int, settings: dict[str, Any]) -> LabelledPair:
    """Pair `index` of a seed; `settings` are those of `TrainingConfig`.

    Raises:
        ConfigError: a setting is unknown or out of range.
    """
    try:
        config = TrainingConfig.model_validate(settings)
    except ValidationError as error:
        raise ConfigError(
            format_validation_error(error, TrainingConfig, prefix="examples.world")
        ) from error
    pair = training_pair(seed, index, config)
    return LabelledPair(pair.previous, pair.current, _labels(pair))


def _labels(pair: TrainingPair) -> Labels:
    """Objects numbered from 0; each has the mean of its points as its centre."""
    then, now = pair.previous_truth, pair.current_truth
    ids = np.unique(now.object_id[now.object_id >= 0])
    elapsed_s = seconds_between(pair.previous.stamp_ns, pair.current.stamp_ns)
    current_object = _numbered(now.object_id, ids)
    centre = _means(pair.current.xyz_m[:, :2], current_object, len(ids))
    way = _means(now.velocity_mps, current_object, len(ids)) * np.float32(elapsed_s)
    return Labels(
        previous_object=_numbered(then.object_id, ids),
        current_object=current_object,
        velocity_mps=now.velocity_mps,
        centre_m=np.stack((centre - way, centre), axis=1).astype(np.float32),
    )


def _numbered(object_id: I64, ids: I64) -> I16:
    """Row of each point's object among the sorted `ids`, -1 for others and the background."""
    if not len(ids):
        return np.full(len(object_id), -1, np.int16)
    rows = np.minimum(np.searchsorted(ids, object_id), len(ids) - 1)
    return np.where(ids[rows] == object_id, rows, -1).astype(np.int16)


def _means(values: F32, rows: I16, count: int) -> F32:
    """(K,2) mean of the values (N,2) of each object's points."""
    on = rows >= 0
    points = np.maximum(np.bincount(rows[on], minlength=count), 1)
    sums = [np.bincount(rows[on], weights=values[on, i], minlength=count) for i in range(2)]
    return (np.stack(sums, axis=1) / points[:, None]).astype(np.float32)
