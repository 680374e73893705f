"""Settings of a folder of own logs."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.datasets.detection_files import DetectorConfig
from mottrack.datasets.vehicle import VehicleOutline


class FolderConfig(StrictModel):
    """A folder with one folder a log; docs/own_logs.md has the format."""

    root: Path = Field(description="folder that holds a folder for each log")
    scenes: tuple[str, ...] | None = Field(None, description="log names; none given: all")
    detections: Path | None = Field(
        None,
        description="table or export of detections; relative: to the working folder or root; "
        "{scene}: a file each; null: detections.csv of each log",
    )
    detector: DetectorConfig = DetectorConfig()
    key_frames: Literal["all", "labelled"] = Field(
        "all", description="frames at which trackers step; labelled: those in boxes.csv"
    )
    classes: tuple[str, ...] = Field(
        ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck"),
        min_length=1,
        description="labels that are scored",
    )
    lidar_origin_m: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="optical centre of the LiDAR in the ego frame"
    )
    fitted_velocity: bool = Field(
        True, description="true velocities: a robust fit over 0.6 s, else differences of boxes"
    )
    vehicle: VehicleOutline | None = Field(
        None, description="outline of your vehicle: points inside it are cut; null: none are"
    )
