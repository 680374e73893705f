"""Settings of 123D logs, and the labels of the data sets that come by it."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.datasets.vehicle import VehicleOutline

CLASSES = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")
_CATEGORIES = {
    "bicycle": (
        "BICYCLE",
        "TWO_WHEELER",
        "TYPE_CYCLIST",
        "VEHICLE_BICYCLE",
        "VEHICLE_PERSONAL_MOBILITY_BYCICLE",
    ),
    "bus": (
        "ARTICULATED_BUS",
        "BUS",
        "SCHOOL_BUS",
        "TROLLEY_BUS",
        "VEHICLE_BUS",
        "VEHICLE_BUS_BENDY",
        "VEHICLE_BUS_RIGID",
    ),
    "car": (
        "AUTOMOBILE",
        "CAR",
        "REGULAR_VEHICLE",
        "TYPE_VEHICLE",
        "VEHICLE",
        "VEHICLE_CAR",
    ),
    "motorcycle": ("MOTORCYCLE", "VEHICLE_MOTORCYCLE"),
    "pedestrian": (
        "HUMAN",
        "HUMAN_PEDESTRIAN",
        "HUMAN_PEDESTRIAN_ADULT",
        "HUMAN_PEDESTRIAN_CHILD",
        "HUMAN_PEDESTRIAN_CONSTRUCTION_WORKER",
        "HUMAN_PEDESTRIAN_POLICE_OFFICER",
        "OFFICIAL_SIGNALER",
        "PEDESTRIAN",
        "PEDESTRIAN_WITH_OBJECT",
        "PERSON",
        "TYPE_PEDESTRIAN",
    ),
    "trailer": ("TRAILER", "VEHICLE_TRAILER", "VEHICULAR_TRAILER"),
    "truck": (
        "BOX_TRUCK",
        "HEAVY_TRUCK",
        "LARGE_VEHICLE",
        "MEDIUM_SIZED_TRUCK",
        "PICKUP_TRUCK",
        "SEMI_TRUCK",
        "TRUCK",
        "TRUCK_CAB",
        "VEHICLE_TRUCK",
    ),
}
CLASS_MAP = {name: label for label, names in _CATEGORIES.items() for name in names}
"""Name of a label in py123d's lists (Argoverse 2, CARLA, KITTI-360, nuPlan, nuScenes, PandaSet,
PhysicalAI, Waymo) to class. Others keep their own name in lower case: they are not scored."""


class Py123dConfig(StrictModel):
    """Logs of 123D on disk."""

    root: Path = Field(description="folder of the logs: `<split>/<log>/sync.arrow`")
    split: str | None = Field(None, description="folder of one split; none: all")
    scenes: tuple[str, ...] | None = Field(None, description="log names; none given: all")
    frames: int | None = Field(None, ge=1, description="only the first so many frames")
    class_map: dict[str, str] = Field(CLASS_MAP, description="name of a label to class")
    fitted_velocity: bool = Field(
        True, description="true velocities: a robust fit over 0.6 s, else differences of boxes"
    )
    vehicle: VehicleOutline | None = Field(
        None, description="points inside it are returns of the own body, and cut; null: none"
    )
