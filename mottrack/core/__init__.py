"""Types, interfaces and errors. Depends on numpy alone and on no other package of mottrack."""

from mottrack.core.errors import (
    ConfigError,
    DataError,
    InputError,
    MottrackError,
    MottrackWarning,
    ResultError,
)
from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import (
    Dataset,
    FlowSource,
    FlowSourceBase,
    FrameObserver,
    GroundMap,
    GroundUser,
    ObjectSource,
    ObjectSourceBase,
    Scene,
    TableEntry,
    Tracker,
)
from mottrack.core.motion import FlowField, VelocityMeasurement
from mottrack.core.objects import Boxes, Objects, Tracks, Truth
from mottrack.core.pose import Pose
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.core.sweep import Sweep
from mottrack.core.tables import FlowSamples, FrameTable, TrackTable, TruthTable

__all__ = [
    "BevGrid",
    "Boxes",
    "ConfigError",
    "DataError",
    "Dataset",
    "FlowField",
    "FlowSamples",
    "FlowSource",
    "FlowSourceBase",
    "Frame",
    "FrameObserver",
    "FrameTable",
    "GroundMap",
    "GroundUser",
    "InputError",
    "MottrackError",
    "MottrackWarning",
    "ObjectSource",
    "ObjectSourceBase",
    "Objects",
    "Pose",
    "ResultError",
    "Scene",
    "SceneResult",
    "Snapshot",
    "Sweep",
    "TableEntry",
    "TrackTable",
    "Tracker",
    "Tracks",
    "Truth",
    "TruthTable",
    "VelocityMeasurement",
]
