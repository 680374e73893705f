"""Classes and settings of Argoverse 2's tracking evaluation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

CATEGORIES = (
    "ARTICULATED_BUS", "BICYCLE", "BICYCLIST", "BOLLARD", "BOX_TRUCK", "BUS", "CONSTRUCTION_BARREL",
    "CONSTRUCTION_CONE", "DOG", "LARGE_VEHICLE", "MESSAGE_BOARD_TRAILER",
    "MOBILE_PEDESTRIAN_CROSSING_SIGN", "MOTORCYCLE", "MOTORCYCLIST", "PEDESTRIAN",
    "REGULAR_VEHICLE", "SCHOOL_BUS", "SIGN", "STOP_SIGN", "STROLLER", "TRUCK", "TRUCK_CAB",
    "VEHICULAR_TRAILER", "WHEELCHAIR", "WHEELED_DEVICE", "WHEELED_RIDER",
)  # fmt: skip
"""That the sensor data set's competitions score; others are left out."""
Objective = Literal["hota", "mota"]
"""What the score threshold of a class is chosen for."""


@dataclass(frozen=True, slots=True)
class Argoverse2Rules:
    """The defaults are the package's."""

    max_range_m: float = 50.0
    """From the vehicle over the ground; a box at exactly this distance counts."""
    zero_distance_m: float = 2.0
    """Similarity of two boxes falls from 1 to 0 over this distance of their centres."""
    min_similarity: float = 0.5
    """Of a match in MOTA: 1 m."""
    levels: int = 10
    """Recall levels from `min_recall` to 1, each with a score threshold."""
    min_recall: float = 0.1
