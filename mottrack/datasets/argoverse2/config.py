"""Settings of an Argoverse 2 data set, and the names of its classes."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.datasets.detection_files import DetectorConfig
from mottrack.datasets.vehicle import VehicleOutline

CLASSES = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")
CLASS_MAP = {
    "REGULAR_VEHICLE": "car",
    "LARGE_VEHICLE": "truck",
    "BOX_TRUCK": "truck",
    "TRUCK": "truck",
    "TRUCK_CAB": "truck",
    "BUS": "bus",
    "SCHOOL_BUS": "bus",
    "ARTICULATED_BUS": "bus",
    "VEHICULAR_TRAILER": "trailer",
    "BICYCLE": "bicycle",
    "MOTORCYCLE": "motorcycle",
    "PEDESTRIAN": "pedestrian",
    "OFFICIAL_SIGNALER": "pedestrian",
    "Car": "car",
    "Pickup Truck": "truck",
    "Medium-sized Truck": "truck",
    "Semi-truck": "truck",
    "Bus": "bus",
    "Motorcycle": "motorcycle",
    "Bicycle": "bicycle",
    "Pedestrian": "pedestrian",
    "Pedestrian with Object": "pedestrian",
}
"""Argoverse category to tracking class, and PandaSet's for logs in this layout.

Other categories keep their own name in lower case: they are not scored (a rider is a cuboid
beside that of the bicycle), but flow truth needs them.
"""


VEHICLE = VehicleOutline(front_m=3.9, rear_m=1.8, side_m=1.1)
"""A Ford Fusion, 4.87 by 2.12 m with mirrors, from its rear axle (3.81 m to the bumper, 1.06 m
behind), and what 7 m/s shift in the 0.1 s of a revolution."""


class Argoverse2Config(StrictModel):
    """An Argoverse 2 sensor data set on disk, or another one converted to its layout."""

    root: Path = Field(description="folder that holds `train`, `val` or `test`")
    split: str = Field("val", description="folder of the split")
    scenes: tuple[str, ...] | None = Field(None, description="log names; none given: all")
    frames: int | None = Field(None, ge=1, description="only the first so many frames")
    require_sweeps: bool = Field(False, description="only frames that have a sweep")
    detections: Path | None = Field(
        None,
        description="feather file of detections, a table or an export; relative: to the working "
        "folder or root; {scene}: a file each",
    )
    detector: DetectorConfig = DetectorConfig()
    class_map: dict[str, str] = Field(CLASS_MAP, description="category to label")
    lidar_origin_m: tuple[float, float, float] = Field(
        (1.35, 0.0, 1.64),
        description="optical centre in the ego frame, where a log has no calibration folder",
    )
    fitted_velocity: bool = Field(
        True, description="true velocities: a robust fit over 0.6 s, else differences of boxes"
    )
    vehicle: VehicleOutline | None = Field(
        VEHICLE, description="points inside it are returns of the own body, and cut; null: none"
    )
