"""The Kalman tracker: detections and measured velocities in, tracks out."""

from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.tracker import KalmanTracker

__all__ = ["KalmanConfig", "KalmanTracker"]
