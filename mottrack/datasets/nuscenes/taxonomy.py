"""The official lists of nuScenes that every version repeats: categories, attributes, visibility."""

from __future__ import annotations

from mottrack.datasets.nuscenes.config import CATEGORY_MAP

CATEGORIES = (
    *CATEGORY_MAP,
    "human.pedestrian.wheelchair",
    "human.pedestrian.stroller",
    "human.pedestrian.personal_mobility",
    "animal",
    "vehicle.emergency.ambulance",
    "vehicle.emergency.police",
    "vehicle.construction",
    "movable_object.barrier",
    "movable_object.trafficcone",
    "movable_object.pushable_pullable",
    "movable_object.debris",
    "static_object.bicycle_rack",
)
_CHOSEN = {"pedestrian": "human.pedestrian.adult", "bus": "vehicle.bus.rigid"}
_MOVING_MPS = 0.5
ATTRIBUTES = (
    "vehicle.moving",
    "vehicle.stopped",
    "vehicle.parked",
    "cycle.with_rider",
    "cycle.without_rider",
    "pedestrian.sitting_lying_down",
    "pedestrian.standing",
    "pedestrian.moving",
)
VISIBILITIES = {"1": "v0-40", "2": "v40-60", "3": "v60-80", "4": "v80-100"}


def category_of(label: str) -> str:
    """Return the official category of a label; what is in no list is debris."""
    official = {name: category for category, name in CATEGORY_MAP.items()} | _CHOSEN
    category = official.get(label, label)
    return category if category in CATEGORIES else "movable_object.debris"


def attribute_of(category: str, speed_mps: float) -> str | None:
    """Return the attribute that tells whether it moves; None where nuScenes has none."""
    moving = speed_mps > _MOVING_MPS
    if category.startswith("human.pedestrian."):
        return "pedestrian.moving" if moving else "pedestrian.standing"
    if category in ("vehicle.bicycle", "vehicle.motorcycle"):
        return "cycle.with_rider" if moving else "cycle.without_rider"
    if category.startswith("vehicle."):
        return "vehicle.moving" if moving else "vehicle.parked"
    return None
