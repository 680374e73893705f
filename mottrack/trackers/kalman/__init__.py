"""The Kalman tracker on detections, with measured velocities."""

from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.tracker import KalmanTracker

__all__ = ["KalmanConfig", "KalmanTracker"]
