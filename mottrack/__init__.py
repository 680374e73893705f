"""mottrack: multi-object tracking on LiDAR with velocities measured by bird's-eye-view flow.

``import mottrack`` needs numpy alone: trackers, `Pipeline`, the functions and the packages
(``datasets``, ``flow``, ``objects``, ``trackers``, ``eval``) import further libraries when they are
first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mottrack._version import __version__
from mottrack.core import (
    BevGrid,
    FlowField,
    Frame,
    MottrackError,
    Objects,
    Pose,
    SceneResult,
    Sweep,
    Tracks,
    VelocityMeasurement,
)

if TYPE_CHECKING:
    from mottrack.api import compare, evaluate, load, run
    from mottrack.pipeline.stream import Pipeline
    from mottrack.report.plots import plot_differences
    from mottrack.trackers import FixedLagTracker, KalmanTracker
    from mottrack.viz.plots import plot_boxes, plot_flow, plot_scene

LATER = {
    "FixedLagTracker": "mottrack.trackers",
    "KalmanTracker": "mottrack.trackers",
    "Pipeline": "mottrack.pipeline.stream",
    "compare": "mottrack.api",
    "evaluate": "mottrack.api",
    "load": "mottrack.api",
    "plot_boxes": "mottrack.viz.plots",
    "plot_differences": "mottrack.report.plots",
    "plot_flow": "mottrack.viz.plots",
    "plot_scene": "mottrack.viz.plots",
    "run": "mottrack.api",
}
"""Public names to the modules that hold them, which are imported when a name is first used."""

__all__ = [
    "BevGrid",
    "FixedLagTracker",
    "FlowField",
    "Frame",
    "KalmanTracker",
    "MottrackError",
    "Objects",
    "Pipeline",
    "Pose",
    "SceneResult",
    "Sweep",
    "Tracks",
    "VelocityMeasurement",
    "__version__",
    "compare",
    "evaluate",
    "load",
    "plot_boxes",
    "plot_differences",
    "plot_flow",
    "plot_scene",
    "run",
]


def __getattr__(name: str) -> Any:
    if name not in LATER:
        raise AttributeError(f"module 'mottrack' has no attribute '{name}'")
    return getattr(import_module(LATER[name]), name)


def __dir__() -> list[str]:
    return __all__
