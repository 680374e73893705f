"""Trackers: Kalman filter banks on detections, fixed-lag smoothing on clusters.

TRACKERS names every tracker that a configuration can ask for. A tracker is imported only when it
is asked for: the Kalman tracker needs numba, the fixed-lag tracker GTSAM.
"""

from typing import TYPE_CHECKING, Any

from mottrack.core.interfaces import TableEntry

if TYPE_CHECKING:
    from mottrack.trackers.fixed_lag import FixedLagTracker
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

__all__ = ["TRACKERS", "FixedLagTracker", "KalmanTracker"]


def __getattr__(name: str) -> Any:
    if name == "KalmanTracker":
        from mottrack.trackers.kalman import KalmanTracker

        return KalmanTracker
    if name == "FixedLagTracker":
        from mottrack.trackers.fixed_lag import FixedLagTracker

        return FixedLagTracker
    raise AttributeError(f"module 'mottrack.trackers' has no attribute '{name}'")
