"""mottrack: multi-object tracking on LiDAR with velocities measured by bird's-eye-view flow.

``import mottrack`` needs numpy alone; each room (``datasets``, ``flow``, ``objects``,
``trackers``, ``eval``) brings in its own dependencies where it is used.
"""

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

__version__ = "0.1.0"
__all__ = [
    "BevGrid",
    "FlowField",
    "Objects",
    "Pose",
    "SceneResult",
    "Sweep",
    "Tracks",
    "VelocityMeasurement",
    "__version__",
]
