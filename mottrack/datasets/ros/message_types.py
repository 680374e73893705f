"""Types of ROS messages: those of ROS 2 Humble, and of packages that are not part of it."""

from __future__ import annotations

from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

POINT_TYPES = ("sensor_msgs/msg/PointCloud2",)
ODOMETRY_TYPES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""The second is that of ROS 1 before tf2."""
DETECTION_ARRAY = "vision_msgs/msg/Detection3DArray"
BOX_TYPES = (
    DETECTION_ARRAY,
    "autoware_perception_msgs/msg/DetectedObjects",
    "autoware_perception_msgs/msg/TrackedObjects",
    "autoware_perception_msgs/msg/PredictedObjects",
    "autoware_auto_perception_msgs/msg/DetectedObjects",
    "autoware_auto_perception_msgs/msg/TrackedObjects",
    "autoware_auto_perception_msgs/msg/PredictedObjects",
)
"""Boxes of detectors and trackers; the last three under the name that they had before 2023."""

# vision_msgs 4 (Humble and later): rosbags' types are those of ROS' own repositories alone
_VISION_MSGS = {
    "ObjectHypothesis": "string class_id\nfloat64 score\n",
    "ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
    ),
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\nstring id\n"
    ),
    "Detection3DArray": ("std_msgs/Header header\nvision_msgs/Detection3D[] detections\n"),
}


def new_type_store() -> Any:
    """Return a store of rosbags with the types of ROS 2 Humble and of vision_msgs 4."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    definitions: dict[str, Any] = {}
    for name, text in _VISION_MSGS.items():
        definitions |= get_types_from_msg(text, f"vision_msgs/msg/{name}")
    store.register(definitions)
    return store


@cache
def type_store() -> Any:
    """Return the store that messages are written with; nobody adds a type to it."""
    return new_type_store()
