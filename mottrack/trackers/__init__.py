"""Trackers: Kalman banks on detections, fixed-lag smoothing on clusters.

TRACKERS names every tracker a configuration can ask for; nothing behind the table is imported
before it is asked for.
"""

from mottrack.trackers.kalman import KalmanTracker

TRACKERS: dict[str, str] = {
    "kalman": "mottrack.trackers.kalman:KalmanTracker",
    "fixed_lag": "mottrack.trackers.fixed_lag:FixedLagTracker",
}

__all__ = ["TRACKERS", "KalmanTracker"]
