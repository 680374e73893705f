"""Trackers: Kalman filter banks on detections, fixed-lag smoothing on clusters.

TRACKERS names every tracker that a configuration can ask for. The fixed-lag tracker is imported
only when it is asked for, since it needs GTSAM.
"""

from mottrack.trackers.kalman import KalmanTracker

TRACKERS: dict[str, str] = {
    "kalman": "mottrack.trackers.kalman:KalmanTracker",
    "fixed_lag": "mottrack.trackers.fixed_lag:FixedLagTracker",
}

__all__ = ["TRACKERS", "KalmanTracker"]
