"""Settings of a nuScenes data set, and of its dialects."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.datasets.detection_files import DetectorConfig
from mottrack.datasets.vehicle import VehicleOutline

VEHICLE = VehicleOutline(front_m=3.5, rear_m=1.4, side_m=1.0)
"""A Renault Zoe, 4.08 by 1.95 m with mirrors, from its rear axle (3.43 m to the bumper, 0.66 m
behind), and what 14 m/s shift in the 0.05 s of a revolution."""


class TablesConfig(StrictModel):
    """What all data sets with nuScenes' tables can be told."""

    root: Path = Field(description="folder of the data set")
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
    interpolate_truth: bool = Field(
        False, description="truth at the sweeps between key frames, interpolated"
    )
    follow_links: bool = Field(
        False, description="allow links that lead out of the root (several disks)"
    )
    cache: bool = Field(True, description="keep an index of large tables on disk")
    cache_dir: Path | None = Field(None, description="default: `~/.cache/mottrack`")


class NuScenesConfig(TablesConfig):
    """A nuScenes data set on disk."""

    root: Path = Field(description="folder that holds `v1.0-*`, `samples` and `sweeps`")
    version: str | None = Field(
        None, description="folder of tables; none: by split or the only one"
    )
    split: str | None = Field(
        None, description="official split or a text file of scene names; none: every scene"
    )
    rate_hz: Literal[2, 10, 20] = Field(
        10, description="frames: key frames only, every second sweep, every sweep"
    )
    vehicle: VehicleOutline | None = Field(
        VEHICLE, description="points inside it are returns of the own body, and cut; null: none"
    )


class TruckScenesConfig(TablesConfig):
    """A MAN TruckScenes data set on disk."""

    root: Path = Field(description="folder that holds `v1.0-*`, `samples` and `sweeps`")
    version: str | None = Field(
        None, description="folder of tables; none: by split or the only one"
    )
    split: str | None = Field(
        None, description="official split or a text file of scene names; none: every scene"
    )
    rate_hz: Literal[2, 10] = Field(10, description="frames: key frames only, or every sweep")
    vehicle: VehicleOutline | None = Field(
        None, description="points inside it are returns of the own body, and cut; null: none"
    )


class T4Config(TablesConfig):
    """Data sets of Autoware's T4 format on disk, one scene each."""

    root: Path = Field(description="folder of data sets, or one that holds `annotation`")
    rate_hz: Literal[2, 10] = Field(10, description="frames: key frames only, or every sweep")
    vehicle: VehicleOutline | None = Field(
        None, description="points inside it are returns of the own body, and cut; null: none"
    )


RatedConfig = NuScenesConfig | TruckScenesConfig | T4Config
