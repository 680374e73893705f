"""Whether a Kalman tracker's covariances are honest, class by class, on recorded scenes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, Texts
from mottrack.core.objects import Objects, Tracks, Truth
from mottrack.studies.tuning.recorded import RecordedScene
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.tracker import KalmanTracker
from mottrack.trackers.noise_estimation.consistency import Consistency, consistency, nees
from mottrack.trackers.noise_estimation.samples import match_truth

NIS_BOX, NIS_XY = "NIS of the box", "NIS of x, y"
NEES_STATE, NEES_VELOCITY = "NEES of x, y, d_x, d_y", "NEES of the velocity"
"""Names in tables; the velocity is the published one, of standing and moving mixed."""
COMPONENTS = {NIS_BOX: 7, NIS_XY: 2, NEES_STATE: 4, NEES_VELOCITY: 2}
"""Numbers in each: the expectation of a consistent filter."""
ALL = ""
"""In place of a class: all of them."""


class Measured(NamedTuple):
    """Normalised squared errors (N,) of one quantity, with the class of each."""

    squared: F64
    label: Texts

    def of(self, label: str, components: int) -> Consistency:
        """Summarise a class, or `ALL`."""
        rows = self.label == label if label else np.ones(len(self.label), np.bool_)
        return consistency(self.squared[rows], components)


@dataclass(frozen=True)
class Errors:
    """Normalised squared errors of a tracker over scenes, by quantity (`COMPONENTS`)."""

    measured: dict[str, Measured]

    def summary(self, label: str = ALL) -> dict[str, Consistency]:
        """Return how consistent each quantity is for a class, or for all."""
        return {name: one.of(label, COMPONENTS[name]) for name, one in self.measured.items()}


def measure(scenes: Iterable[RecordedScene], config: KalmanConfig) -> Errors:
    """Run the tracker over scenes and normalise its errors by the covariances that it states.

    Only detections and tracks that match a true box of their class count (`match_truth`). `config`
    is in seconds.
    """
    parts: dict[str, list[Measured]] = {name: [_none()] for name in COMPONENTS}
    for scene in scenes:
        tracker = KalmanTracker(config.model_copy(update={"diagnose": True}))
        for objects, truth in scene.truth_frames():
            tracks = tracker.step(objects.stamp_ns, objects)
            for name, found in (
                *_innovations(tracker, objects, truth),
                (NEES_STATE, _state(tracks, truth)),
                (NEES_VELOCITY, _velocity(tracks, truth)),
            ):
                parts[name].append(found)
    return Errors({name: _joined(found) for name, found in parts.items()})


def joined(parts: Iterable[Errors]) -> Errors:
    """Return the errors of several sets of scenes together."""
    listed = list(parts)
    names = {name: [_none(), *(one.measured[name] for one in listed)] for name in COMPONENTS}
    return Errors({name: _joined(found) for name, found in names.items()})


def _innovations(
    tracker: KalmanTracker, objects: Objects, truth: Truth
) -> Iterable[tuple[str, Measured]]:
    found = tracker.innovations
    if found is None:
        return
    true = np.isin(found.source, match_truth(objects, truth)[0])
    label = objects.label[found.source[true]]
    yield NIS_BOX, Measured(found.box[true], label)
    yield NIS_XY, Measured(found.xy[true], label)


def _state(tracks: Tracks, truth: Truth) -> Measured:
    return Measured(*nees(tracks, truth))


def _velocity(tracks: Tracks, truth: Truth) -> Measured:
    seen = tracks.select(tracks.observed)
    i, j = match_truth(seen, truth)
    known = np.isfinite(truth.velocity_mps[j]).all(axis=1)
    i, j = i[known], j[known]
    error = seen.velocity_mps[i] - truth.velocity_mps[j]
    solved = np.linalg.solve(seen.velocity_covariance_m2ps2[i], error[:, :, None])[:, :, 0]
    return Measured(np.sum(error * solved, axis=1), seen.label[i])


def _none() -> Measured:
    return Measured(np.empty(0), np.empty(0, np.str_))


def _joined(parts: list[Measured]) -> Measured:
    return Measured(*(np.concatenate(column) for column in zip(*parts, strict=True)))
