"""mottrack: multi-object tracking on LiDAR with velocities measured by bird's-eye-view flow.

``import mottrack`` costs nothing: each name is brought in when it is first used. The types need
numpy alone; each room (``datasets``, ``flow``, ``objects``, ``trackers``, ``eval``) brings in its
own dependencies where it is used, and so does ``Pipeline``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mottrack._version import __version__

if TYPE_CHECKING:
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
    if name not in __all__:
        raise AttributeError(f"module 'mottrack' has no attribute '{name}'")
    home = "mottrack.pipeline.stream" if name == "Pipeline" else "mottrack.core"
    value = globals()[name] = getattr(import_module(home), name)
    return value


def __dir__() -> list[str]:
    return __all__
