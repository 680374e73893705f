"""Stone Soup: global nearest neighbour by Mahalanobis distance, constant velocity in the plane.

One tracker a class, as its own examples put it together.
"""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np
from peer import Detected, Found, table
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.deleter.time import UpdateTimeStepsDeleter
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.initiator.simple import SimpleMeasurementInitiator
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import KalmanUpdater

START = datetime.datetime(2026, 1, 1)
"""Its times are dates; which one does not matter."""
GATE = 5
"""Sigma, as the default preset's."""
MISSES = 3
"""Steps that a track outlives without a detection: it is published in all of them."""


class StoneSoupPeer:
    """One tracker a class."""

    def __init__(self) -> None:
        self._of_class: dict[int, _ClassTracker] = {}
        self._identities: dict[str, int] = {}

    def prepared(self, seen: Detected) -> tuple[datetime.datetime, dict[int, set[Detection]]]:
        """Return the detections by class; those without any have an empty set."""
        stamp = START + datetime.timedelta(microseconds=seen.stamp_ns / 1e3)
        for label in np.unique(seen.label).tolist():
            self._of_class.setdefault(label, _ClassTracker())
        by_class: dict[int, set[Detection]] = {label: set() for label in self._of_class}
        for box, label, score in zip(seen.box, seen.label.tolist(), seen.score, strict=True):
            by_class[label].add(
                Detection(
                    box[:2, None],
                    timestamp=stamp,
                    measurement_model=self._of_class[label].measurement,
                    metadata={"box": box, "score": score},
                )
            )
        return stamp, by_class

    def step(self, prepared: tuple[datetime.datetime, dict[int, set[Detection]]]) -> Any:
        """Return the live tracks of every class."""
        stamp, by_class = prepared
        for label, detections in by_class.items():
            self._of_class[label].step(stamp, detections)
        return {label: self._of_class[label].tracks for label in by_class}

    def found(self, returned: Any) -> Found:
        """Return their states; the rest of a box is that of the last detection."""
        rows = []
        for label, tracks in returned.items():
            for track in tracks:
                x, dx, y, dy = np.ravel(track.state_vector).tolist()
                identity = self._identities.setdefault(track.id, len(self._identities))
                data = track.metadata
                rows.append((x, y, *data["box"][2:], label, data["score"], identity, dx, dy))
        return table(rows)


class _ClassTracker:
    """One class: predict, associate, update, delete, initiate."""

    def __init__(self) -> None:
        transition = CombinedLinearGaussianTransitionModel([ConstantVelocity(4.0)] * 2)
        self.measurement = LinearGaussian(4, (0, 2), np.diag([0.06, 0.06]))
        self._updater = KalmanUpdater(self.measurement)
        hypothesiser = DistanceHypothesiser(
            KalmanPredictor(transition), self._updater, Mahalanobis(), missed_distance=GATE
        )
        self._associator = GNNWith2DAssignment(hypothesiser)
        self._deleter = UpdateTimeStepsDeleter(MISSES)
        prior = GaussianState([[0], [0], [0], [0]], np.diag([0.06, 36, 0.06, 36]))
        self._initiator = SimpleMeasurementInitiator(prior, self.measurement)
        self.tracks: set[Any] = set()

    def step(self, stamp: datetime.datetime, detections: set[Detection]) -> None:
        hypotheses = self._associator.associate(self.tracks, detections, stamp)
        used = set()
        for track, hypothesis in hypotheses.items():
            if hypothesis.measurement:
                track.append(self._updater.update(hypothesis))
                used.add(hypothesis.measurement)
            else:
                track.append(hypothesis.prediction)
        self.tracks -= self._deleter.delete_tracks(self.tracks)
        self.tracks |= self._initiator.initiate(detections - used, stamp)
