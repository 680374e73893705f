"""Argoverse 2's categories, and which of them the figures of scene flow put together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mottrack.core.arrays import I64

BACKGROUND = 0
"""Number of a point that no labelled object holds."""
CATEGORIES = (
    "BACKGROUND", "ANIMAL", "ARTICULATED_BUS", "BICYCLE", "BICYCLIST", "BOLLARD", "BOX_TRUCK",
    "BUS", "CONSTRUCTION_BARREL", "CONSTRUCTION_CONE", "DOG", "LARGE_VEHICLE",
    "MESSAGE_BOARD_TRAILER", "MOBILE_PEDESTRIAN_CROSSING_SIGN", "MOTORCYCLE", "MOTORCYCLIST",
    "OFFICIAL_SIGNALER", "PEDESTRIAN", "RAILED_VEHICLE", "REGULAR_VEHICLE", "SCHOOL_BUS", "SIGN",
    "STOP_SIGN", "STROLLER", "TRAFFIC_LIGHT_TRAILER", "TRUCK", "TRUCK_CAB", "VEHICULAR_TRAILER",
    "WHEELCHAIR", "WHEELED_DEVICE", "WHEELED_RIDER",
)  # fmt: skip
"""By their number in the challenge's annotation files."""
GROUPS = {
    "BACKGROUND": ("BACKGROUND",),
    "CAR": ("REGULAR_VEHICLE",),
    "OTHER_VEHICLES": (
        "ARTICULATED_BUS", "BOX_TRUCK", "BUS", "LARGE_VEHICLE", "RAILED_VEHICLE", "SCHOOL_BUS",
        "TRUCK", "TRUCK_CAB", "VEHICULAR_TRAILER",
    ),
    "PEDESTRIAN": ("OFFICIAL_SIGNALER", "PEDESTRIAN", "STROLLER", "WHEELCHAIR"),
    "WHEELED_VRU": (
        "BICYCLE", "BICYCLIST", "MOTORCYCLE", "MOTORCYCLIST", "WHEELED_DEVICE", "WHEELED_RIDER",
    ),
}  # fmt: skip
"""Classes of the bucketed figures (Khatri et al., 2024). Signs, barrels, animals and trailers
with boards or lights are in none: their labels are unreliable."""
CATEGORY_OF = {
    "car": "REGULAR_VEHICLE", "van": "REGULAR_VEHICLE", "trailer": "VEHICULAR_TRAILER",
    "tram": "RAILED_VEHICLE", "cyclist": "BICYCLIST", "person": "PEDESTRIAN",
    "person_sitting": "PEDESTRIAN", "construction_vehicle": "LARGE_VEHICLE",
    "emergency_vehicle": "LARGE_VEHICLE", "traffic_cone": "CONSTRUCTION_CONE",
    "barrier": "CONSTRUCTION_BARREL", "debris": "CONSTRUCTION_BARREL", "ball": "ANIMAL",
}  # fmt: skip
"""Category of a label that is not a category's own name in lower case: of the data sets read
here, and of the embedded world, whose balls and debris are unknown objects as animals are."""
UNKNOWN = -1
"""A label without a category: its points are not evaluated."""


def category_numbers(labels: Sequence[str]) -> I64:
    """Return the category's number of each label, `UNKNOWN` where it has none, (N,).

    >>> category_numbers(["car", "pedestrian", "wheeled_rider", "kite"]).tolist()
    [19, 17, 30, -1]
    """
    number_of = {name: number for number, name in enumerate(CATEGORIES)}
    names = [CATEGORY_OF.get(label.lower(), label.upper()) for label in labels]
    return np.array([number_of.get(name, UNKNOWN) for name in names], np.int64)


def group_table() -> I64:
    """Return the row in `GROUPS` of each category, -1 for those in none, (31,)."""
    table = np.full(len(CATEGORIES), -1, np.int64)
    for row, members in enumerate(GROUPS.values()):
        table[[CATEGORIES.index(name) for name in members]] = row
    return table
