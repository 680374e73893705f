"""Settings of a nuScenes data set, and the names of its classes."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from mottrack.config import StrictModel

CLASSES = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")
"""The seven classes of the nuScenes tracking benchmark."""

CATEGORY_MAP = {
    "human.pedestrian.adult": "pedestrian",
    "human.pedestrian.child": "pedestrian",
    "human.pedestrian.construction_worker": "pedestrian",
    "human.pedestrian.police_officer": "pedestrian",
    "vehicle.bicycle": "bicycle",
    "vehicle.bus.bendy": "bus",
    "vehicle.bus.rigid": "bus",
    "vehicle.car": "car",
    "vehicle.motorcycle": "motorcycle",
    "vehicle.trailer": "trailer",
    "vehicle.truck": "truck",
}
"""Official category to tracking class. Other categories keep their own full name in the truth:
they are not scored, but some of them move and flow truth needs them."""

DETECTION_NAMES = (*CLASSES, "barrier", "construction_vehicle", "traffic_cone")
"""What a detection file may hold; the last three are not tracked and are left out."""


class NuScenesConfig(StrictModel):
    """A nuScenes data set on disk."""

    root: Path = Field(description="folder that holds `v1.0-*`, `samples` and `sweeps`")
    version: str | None = Field(
        None, description="folder of tables; none: by split or the only one"
    )
    split: str | None = Field(
        None, description="official split or a text file of scene names; none: every scene"
    )
    scenes: tuple[str, ...] | None = Field(None, description="scene names out of the split")
    detections: Path | None = Field(
        None, description="detection file in the official format; relative: working folder, root"
    )
    detector_velocity: bool = Field(
        False, description="use the detector's own velocities as measurements"
    )
    rate_hz: Literal[2, 10, 20] = Field(
        10, description="frames: key frames only, every second sweep, every sweep"
    )
    interpolate_truth: bool = Field(
        False, description="truth at the sweeps between key frames, interpolated"
    )
    follow_links: bool = Field(
        False, description="allow links that lead out of the root (several disks)"
    )
    cache: bool = Field(True, description="keep an index of large tables on disk")
    cache_dir: Path | None = Field(None, description="default: `~/.cache/mottrack`")
