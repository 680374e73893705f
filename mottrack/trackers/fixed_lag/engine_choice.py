"""The engine that a configuration names."""

from __future__ import annotations

from mottrack.core.errors import ConfigError
from mottrack.core.sweep import SECOND_NS
from mottrack.trackers.fixed_lag.config import FixedLagConfig
from mottrack.trackers.fixed_lag.engine import Engine
from mottrack.trackers.fixed_lag.numpy_engine import NumpyEngine


def make_engine(config: FixedLagConfig) -> Engine:
    """Return the engine that a configuration names.

    Raises:
        ConfigError: GTSAM is asked for where it is not installed (there is none for Windows).
    """
    lag_ns = round(config.lag_s * SECOND_NS)
    if config.engine == "numpy":
        return NumpyEngine(config.motion, lag_ns)
    try:
        from mottrack.trackers.fixed_lag.gtsam_engine import GtsamEngine
    except ImportError as missing:
        raise ConfigError(
            f"engine 'gtsam': {missing}; install gtsam or use engine=numpy"
        ) from missing
    return GtsamEngine(config.motion, lag_ns, config.separate_factors)
