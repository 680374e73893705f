"""What differs between data sets with nuScenes' tables: sensors, rates, names, files of points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from mottrack.datasets.nuscenes.points import (
    Points,
    read_nuscenes_points,
    read_t4_points,
    read_truckscenes_points,
)
from mottrack.formats.nuscenes_classes import CLASS_OF_CATEGORY, CLASSES
from mottrack.formats.nuscenes_records import LIDAR_TOP, Channels


@dataclass(frozen=True)
class Dialect:
    """A data set with nuScenes' tables.

    channels: its LiDARs. sensor_hz: revolutions a second.
    classes: labels that are tracked and scored.
    class_of_category: category of the tables to label; others keep their own name.
    detection_names: what a detection file may hold; those that are no class are left out.
    read_points: reads a file of points.
    """

    channels: Channels
    sensor_hz: int
    classes: tuple[str, ...]
    class_of_category: Mapping[str, str]
    detection_names: tuple[str, ...]
    read_points: Callable[[Path], Points]


NUSCENES = Dialect(
    LIDAR_TOP,
    20,  # LIDAR_TOP turns twenty times a second
    CLASSES,
    CLASS_OF_CATEGORY,
    (*CLASSES, "barrier", "construction_vehicle", "traffic_cone"),
    read_nuscenes_points,
)

_T4_PLAIN = {
    "car": "car",
    "police_car": "car",
    "ambulance": "car",
    "truck": "truck",
    "fire_truck": "truck",
    "construction_vehicle": "truck",
    "semi_trailer": "truck",
    "tractor_unit": "truck",
    "trailer": "trailer",
    "bus": "bus",
    "motorcycle": "motorcycle",
    "motorbike": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
    "construction_worker": "pedestrian",
    "police_officer": "pedestrian",
}
"""Category of T4 since 2023 to label. Strollers, wheelchairs and personal mobility are no
pedestrians here, as in nuScenes."""
_T4_DOTTED = {
    "vehicle.car": "car",
    "vehicle.emergency (ambulance & police)": "car",
    "vehicle.ambulance": "car",
    "vehicle.police": "car",
    "vehicle.fire": "truck",
    "vehicle.truck": "truck",
    "vehicle.construction": "truck",
    "vehicle.trailer": "trailer",
    "vehicle.bus": "bus",
    "vehicle.bus (bendy & rigid)": "bus",
    "vehicle.motorcycle": "motorcycle",
    "vehicle.bicycle": "bicycle",
    "pedestrian.adult": "pedestrian",
    "pedestrian.child": "pedestrian",
    "pedestrian.construction_worker": "pedestrian",
    "pedestrian.police_officer": "pedestrian",
}
"""The same with a group before the dot, as T4 wrote them before."""
T4 = Dialect(
    Channels(("LIDAR_CONCAT", "LIDAR_TOP")),
    10,  # Autoware joins its LiDARs ten times a second
    CLASSES,
    {**CLASS_OF_CATEGORY, **_T4_DOTTED, **_T4_PLAIN},
    (*CLASSES, "unknown", "animal", "hazard", "over_drivable", "under_drivable"),
    read_t4_points,
)

TRUCKSCENES_CLASSES = (
    "animal",
    "bicycle",
    "bus",
    "car",
    "motorcycle",
    "other_vehicle",
    "pedestrian",
    "trailer",
    "truck",
)
"""The detection benchmark's twelve classes but for barriers, cones and signs, which never move."""
TRUCKSCENES = Dialect(
    Channels(
        ("LIDAR_LEFT",),
        (
            "LIDAR_RIGHT",
            "LIDAR_TOP_FRONT",
            "LIDAR_TOP_LEFT",
            "LIDAR_TOP_RIGHT",
            "LIDAR_REAR",
        ),
    ),
    10,  # each LiDAR turns ten times a second
    TRUCKSCENES_CLASSES,
    {
        **CLASS_OF_CATEGORY,
        "animal": "animal",
        "vehicle.construction": "other_vehicle",
        "vehicle.other": "other_vehicle",
        "vehicle.ego_trailer": "trailer",
    },
    (*TRUCKSCENES_CLASSES, "barrier", "traffic_cone", "traffic_sign"),
    read_truckscenes_points,
)
