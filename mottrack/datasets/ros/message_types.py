"""Types of ROS messages: those of ROS 2 Humble, and of packages that are not part of it."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

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
    "autoware_auto_perception_msgs/msg/DetectedObjects",
    "autoware_auto_perception_msgs/msg/TrackedObjects",
)
"""Boxes of detectors and trackers; the last two under the name that they had before 2023."""

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


@cache
def type_store() -> Any:
    """Return the types of ROS 2 Humble and of vision_msgs 4, which nobody adds to."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    definitions: dict[str, Any] = {}
    for name, text in _VISION_MSGS.items():
        definitions |= get_types_from_msg(text, f"vision_msgs/msg/{name}")
    store.register(definitions)
    return store


_TYPE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*/msg/[A-Za-z][A-Za-z0-9_]*")
_FIELD_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def store_of(kind: str, text: str, *, idl: bool = False) -> Any:
    """Return a store that decodes messages of a type by the definition that a log holds.

    Types that the definition names without defining them are those of ROS 2 Humble. rosbags makes
    Python classes of definitions by writing code: names from the log are checked before.

    Args:
        kind: `package/msg/Name`.
        text: the definition, those that it needs appended as recorders do.
        idl: whether it is written in IDL.

    Raises:
        ValueError: the definition is damaged, or a name in it is none.
        KeyError: it names a type that nobody knows.
    """
    defined = _idl_types(text) if idl else get_types_from_msg(text, kind)
    needed = _with_parts(kind, {**type_store().fielddefs, **defined})
    for name, (constants, fields) in needed.items():
        names = [part[0] for part in (*constants, *fields)]
        if not _TYPE_NAME.fullmatch(name) or not all(map(_FIELD_NAME.fullmatch, names)):
            raise ValueError(f"type {name!r} has a name that is none")
    store = get_typestore(Stores.EMPTY)
    store.register(needed)
    return store


def _idl_types(text: str) -> dict[str, Any]:
    """Return the types of IDL texts, one after the other behind lines of `=`."""
    ruler = "=" * 80 + "\n"
    parts = [part.split("\n", 1)[-1] for part in text.split(ruler) if part.startswith("IDL: ")]
    types: dict[str, Any] = {}
    for part in parts or [text]:
        types |= get_types_from_idl(part)
    return types


def _with_parts(kind: str, known: dict[str, Any]) -> dict[str, Any]:
    """Return the definitions of a type and of all that it is made of."""
    found: dict[str, Any] = {}
    waiting = [kind]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name] = known[name]
            waiting += [part for _, field in known[name][1] if (part := _named(field))]
    return found


def _named(field: Any) -> str | None:
    """Return the type that a field, a list or an array of a definition names, if it names one."""
    kind, content = field
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        kind, content = content[0]
    return str(content) if kind == Nodetype.NAME else None
