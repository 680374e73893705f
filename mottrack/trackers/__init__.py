"""Trackers: Kalman banks on detections, fixed-lag smoothing on clusters.

TRACKERS names every tracker that a configuration can ask for. The fixed-lag tracker is imported
when it is asked for, since it brings libraries of its own.
"""

from mottrack.trackers.kalman import KalmanTracker

TRACKERS: dict[str, str] = {
    "kalman": "mottrack.trackers.kalman:KalmanTracker",
    "fixed_lag": "mottrack.trackers.fixed_lag:FixedLagTracker",
}

__all__ = ["TRACKERS", "KalmanTracker"]
