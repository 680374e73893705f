"""mottrack: multi-object tracking on LiDAR with velocities measured by bird's-eye-view flow.

``import mottrack`` needs numpy alone. `Pipeline` and the packages (``datasets``, ``flow``,
``objects``, ``trackers``, ``eval``) import further libraries when they are first used.
"""

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
    from mottrack.pipeline.stream import Pipeline

__all__ = [
    "BevGrid",
    "FlowField",
    "Frame",
    "MottrackError",
    "Objects",
    "Pipeline",
    "Pose",
    "SceneResult",
    "Sweep",
    "Tracks",
    "VelocityMeasurement",
    "__version__",
]


def __getattr__(name: str) -> Any:
    if name != "Pipeline":
        raise AttributeError(f"module 'mottrack' has no attribute '{name}'")
    from mottrack.pipeline.stream import Pipeline

    return Pipeline
