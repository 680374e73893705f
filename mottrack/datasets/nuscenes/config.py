"""Settings of a nuScenes data set, and the names in its detection files."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.datasets.detection_files import DetectorConfig
from mottrack.datasets.vehicle import VehicleOutline
from mottrack.formats.nuscenes_classes import CLASSES

VEHICLE = VehicleOutline(front_m=3.5, rear_m=1.4, side_m=1.0)
"""A Renault Zoe, 4.08 by 1.95 m with mirrors, from its rear axle (3.43 m to the bumper, 0.66 m
behind), and what 14 m/s shift in the 0.05 s of a revolution."""

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
        None,
        description="detection file in the official format, a table or an export; relative: "
        "working folder, root; {scene}: a file each",
    )
    detector: DetectorConfig = DetectorConfig()
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
    vehicle: VehicleOutline | None = Field(
        VEHICLE, description="points inside it are returns of the own body, and cut; null: none"
    )
    cache: bool = Field(True, description="keep an index of large tables on disk")
    cache_dir: Path | None = Field(None, description="default: `~/.cache/mottrack`")
