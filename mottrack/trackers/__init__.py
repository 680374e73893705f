"""Trackers: Kalman filter banks on detections, fixed-lag smoothing on clusters.

TRACKERS names every tracker that a configuration can ask for. The fixed-lag tracker is imported
only when it is asked for, since it needs GTSAM.
"""

from mottrack.core.interfaces import TableEntry
from mottrack.trackers.kalman import KalmanTracker

TRACKERS: dict[str, TableEntry] = {
    "kalman": TableEntry(
        "mottrack.trackers.kalman:KalmanTracker",
        "Kalman filters of all boxes in one batch (Chiu et al., 2020; PillarFlow, section IV-D).",
    ),
    "fixed_lag": TableEntry(
        "mottrack.trackers.fixed_lag:FixedLagTracker",
        "Fixed-lag smoothing over a factor graph, for objects of any shape (section V).",
    ),
}
"""Name in a configuration to its class."""

__all__ = ["TRACKERS", "KalmanTracker"]
