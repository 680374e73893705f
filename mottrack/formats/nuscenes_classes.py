"""The classes of the nuScenes tracking benchmark, and the categories that they come from."""

CLASSES = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")
"""The seven classes of the benchmark."""

CLASS_OF_CATEGORY = {
    "human.pedestrian.adult": "pedestrian",
    "human.pedestrian.child": "pedestrian",
    "human.pedestrian.construction_worker": "pedestrian",
    "human.pedestrian.police_officer": "pedestrian",
    "vehicle.bicycle": "bicycle",
    "vehicle.bus.bendy": "bus",
    "vehicle.bus.rigid": "bus",
    "vehicle.car": "car",
    "vehicle.motorcycle": "motorcycle",
    "vehicle.trailer": "trailer",
    "vehicle.truck": "truck",
}
"""Official category to class; other categories are not evaluated."""

RACK_CATEGORY = "static_object.bicycle_rack"
RACKED_CLASSES = ("bicycle", "motorcycle")
"""Boxes of these classes inside a rack are not evaluated, neither true nor tracked ones."""
