"""Class-agnostic tracking of clusters by fixed-lag smoothing over a factor graph (section V-A)."""

from mottrack.trackers.fixed_lag.config import FixedLagConfig
from mottrack.trackers.fixed_lag.tracker import FixedLagTracker

__all__ = ["FixedLagConfig", "FixedLagTracker"]
