"""Stone Soup on a stored workload: `run_stonesoup.py WORKLOAD.npz FRAMES` prints frames a second.

Global nearest neighbour by Mahalanobis distance with a constant-velocity Kalman filter in the
plane, one tracker a class, as its own examples put it together.
"""

import datetime
import json
import sys
import time

import numpy as np
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

WARM_UP = 5
START = datetime.datetime(2026, 1, 1)


class ClassTracker:
    """One class: predict, associate, update, delete, initiate."""

    def __init__(self) -> None:
        transition = CombinedLinearGaussianTransitionModel([ConstantVelocity(4.0)] * 2)
        measurement = LinearGaussian(4, (0, 2), np.diag([0.06, 0.06]))
        updater = KalmanUpdater(measurement)
        hypothesiser = DistanceHypothesiser(
            KalmanPredictor(transition), updater, Mahalanobis(), missed_distance=5
        )
        self.measurement = measurement
        self.updater = updater
        self.associator = GNNWith2DAssignment(hypothesiser)
        self.deleter = UpdateTimeStepsDeleter(15)
        prior = GaussianState([[0], [0], [0], [0]], np.diag([0.06, 36, 0.06, 36]))
        self.initiator = SimpleMeasurementInitiator(prior, measurement)
        self.tracks: set = set()

    def step(self, stamp: datetime.datetime, centres: np.ndarray) -> None:
        detections = {
            Detection(c[:, None], timestamp=stamp, measurement_model=self.measurement)
            for c in centres
        }
        hypotheses = self.associator.associate(self.tracks, detections, stamp)
        used = set()
        for track, hypothesis in hypotheses.items():
            if hypothesis.measurement:
                track.append(self.updater.update(hypothesis))
                used.add(hypothesis.measurement)
            else:
                track.append(hypothesis.prediction)
        self.tracks -= self.deleter.delete_tracks(self.tracks)
        self.tracks |= self.initiator.initiate(detections - used, stamp)


def main(path: str, frames: int) -> None:
    data = dict(np.load(path))
    labels = np.unique(data["label"]).tolist()
    trackers = {label: ClassTracker() for label in labels}
    start = 0.0
    for k in range(frames):
        if k == WARM_UP:
            start = time.process_time()
        stamp = START + datetime.timedelta(seconds=0.1 * k)
        for label in labels:
            rows = (data["frame"] == k) & (data["label"] == label)
            trackers[label].step(stamp, data["box"][rows, :2])
    speed = (frames - WARM_UP) / (time.process_time() - start)
    print(json.dumps({"frames_per_s": speed}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
