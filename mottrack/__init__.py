"""mottrack: multi-object tracking on LiDAR with velocities measured by bird's-eye-view flow.

``import mottrack`` needs numpy alone; each room (``datasets``, ``flow``, ``objects``,
``trackers``, ``eval``) brings in its own dependencies where it is used, and so does ``Pipeline``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mottrack.core import (
    BevGrid,
    FlowField,
    Objects,
    Pose,
    SceneResult,
    Sweep,
    Tracks,
    VelocityMeasurement,
)

if TYPE_CHECKING:
    from mottrack.pipeline.stream import Pipeline

__version__ = "0.1.0"
__all__ = [
    "BevGrid",
    "FlowField",
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
    if name == "Pipeline":
        return import_module("mottrack.pipeline.stream").Pipeline
    raise AttributeError(f"module 'mottrack' has no attribute '{name}'")
