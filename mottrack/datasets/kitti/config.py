"""Settings of a KITTI tracking data set."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.datasets.detection_files import DetectorConfig
from mottrack.datasets.vehicle import VehicleOutline

CLASSES = ("car", "pedestrian", "cyclist")
CLASS_MAP = {
    "Car": "car",
    "Van": "car",
    "Pedestrian": "pedestrian",
    "Person": "pedestrian",
    "Person_sitting": "pedestrian",
    "Cyclist": "cyclist",
    "Truck": "truck",
    "Tram": "tram",
    "Misc": "misc",
}
"""KITTI's types and their labels. `DontCare` regions have no 3-D box and are
dropped. Truck, tram and misc are not scored, but they move, so flow truth needs them."""


VEHICLE = VehicleOutline(front_m=3.0, rear_m=2.0, side_m=1.1)
"""A Volkswagen Passat, 4.77 by 2.06 m with mirrors, from the Velodyne, which stands 0.76 m before
its rear axle."""


class KittiConfig(StrictModel):
    """A KITTI tracking data set on disk."""

    root: Path = Field(description="folder that holds `training`")
    split: Literal["training", "testing"] = Field("training", description="folder of the split")
    scenes: tuple[str, ...] | None = Field(None, description="sequences; none given: all")
    frames: int | None = Field(None, ge=1, description="only the first so many frames")
    require_sweeps: bool = Field(False, description="only frames that have a sweep")
    velodyne_root: Path | None = Field(
        None, description="folder with `<sequence>/<frame>.bin`; default `<split>/velodyne`"
    )
    detections: str | None = Field(
        "detections/pointrcnn",
        description="folder under the root with `<Class>/<sequence>.txt` (AB3DMOT), or a table, "
        "an export or a folder of `<frame>.txt` with {scene} in its path; null: none",
    )
    detector: DetectorConfig = DetectorConfig()
    poses: Literal["auto", "poses", "oxts", "none"] = Field(
        "auto", description="where ego poses come from; auto: `poses`, else `oxts`; none: at rest"
    )
    period_s: float = Field(
        0.1, ge=0.001, le=10.0, description="time between frames, which KITTI leaves out"
    )
    class_map: dict[str, str] = Field(
        CLASS_MAP, description="KITTI type to label; types left out are dropped"
    )
    fitted_velocity: bool = Field(
        True, description="true velocities: a robust fit over 0.6 s, else differences of boxes"
    )
    vehicle: VehicleOutline | None = Field(
        VEHICLE, description="points inside it are returns of the own body, and cut; null: none"
    )
