"""Markers of rviz and Foxglove: boxes, velocities, names and flow."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mottrack.core.arrays import F32, F64
from mottrack.core.tables import TrackTable
from mottrack.datasets.ros.message_types import type_store
from mottrack.datasets.ros.new_messages import header, new, point, vector, yaw_pose

# visualization_msgs/msg/Marker's numbers of kinds and actions
ARROW, CUBE, LINE_LIST, TEXT = 0, 1, 5, 9
ADD, DELETE_ALL = 0, 3
GOLDEN_RATIO = 0.618033988749895
"""Steps of this share of the hue circle never meet, and neighbours differ strongly."""
BOX_OPACITY = 0.5  # what stands in a box stays visible
SHAFT_M, HEAD_M = 0.15, 0.35
"""Diameters of an arrow: thin beside a car, visible from above."""
TEXT_M = 0.8
"""Height of a capital: readable where a whole junction is in view."""
LINE_M = 0.06
"""Width of a line of flow, a third of a cell."""
STILL_MPS = 0.1
"""Slower than this an arrow would be shorter than its head."""
FULL_COLOUR_MPS = 10.0
"""Speed at which the colour of flow is strongest: traffic in town."""
FLOW_HEIGHT_M = 0.1  # above the ground, which would hide part of it
_NO_DATA = np.zeros(0, np.uint8)
"""Of an image or a mesh that a marker does not have."""


class Colour(NamedTuple):
    """Red, green, blue and opacity in [0, 1]."""

    red: float
    green: float
    blue: float
    opacity: float = 1.0


class Markers:
    """A visualization_msgs/MarkerArray in the making; it begins by removing what was shown."""

    def __init__(self, stamp_ns: int, frame_id: str) -> None:
        self._stamped = header(stamp_ns, frame_id)
        self._made = [_blank(self._stamped, 0, ARROW)]
        self._made[0].action = DELETE_ALL

    def add(self, namespace: str, kind: int, scale: Sequence[float], colour: Colour) -> Any:
        """Return a new marker, to be placed; it has a number of its own."""
        marker = _blank(self._stamped, len(self._made), kind)
        marker.ns = namespace
        marker.scale = vector(scale)
        marker.color = new("std_msgs/ColorRGBA", *colour)
        self._made.append(marker)
        return marker

    def message(self) -> Any:
        """Return the message."""
        return new("visualization_msgs/MarkerArray", self._made)


def track_markers(stamp_ns: int, frame_id: str, tracks: TrackTable) -> Any:
    """Return a visualization_msgs/MarkerArray: box, velocity (one second long) and name of each.

    Args:
        stamp_ns: time of the frame.
        frame_id: frame in which the tracks are given.
        tracks: of one frame.
    """
    markers = Markers(stamp_ns, frame_id)
    for row in range(len(tracks)):
        colour = _colour(int(tracks.id[row]))
        centre_m, size_m = tracks.centre_m[row], tracks.size_m[row]
        box = markers.add("boxes", CUBE, size_m.tolist(), colour._replace(opacity=BOX_OPACITY))
        box.pose = yaw_pose(centre_m, tracks.yaw_rad[row])
        top_m = centre_m + np.array([0.0, 0.0, 0.5 * size_m[2]])
        velocity = np.append(tracks.velocity_mps[row], 0.0)
        if np.hypot(*velocity[:2]) > STILL_MPS:
            arrow = markers.add("velocities", ARROW, (SHAFT_M, HEAD_M, 0.0), colour)
            arrow.points = [point(top_m), point(top_m + velocity)]
        name = markers.add("names", TEXT, (0.0, 0.0, TEXT_M), colour)
        name.pose = yaw_pose(top_m + np.array([0.0, 0.0, TEXT_M]), 0.0)
        name.text = f"{tracks.label[row]} {tracks.id[row]}"
    return markers.message()


def flow_markers(stamp_ns: int, frame_id: str, xy_m: F64, velocity_mps: F32) -> Any:
    """Return a visualization_msgs/MarkerArray: a line of one second from each cell.

    Args:
        stamp_ns: time of the frame.
        frame_id: the frame of the vehicle.
        xy_m: (K, 2) centres of measured cells.
        velocity_mps: (K, 2) their velocities.
    """
    markers = Markers(stamp_ns, frame_id)
    if len(xy_m):
        lines = markers.add("flow", LINE_LIST, (LINE_M, 0.0, 0.0), Colour(1.0, 1.0, 1.0))
        for start, velocity in zip(xy_m, velocity_mps, strict=True):
            from_m = np.append(start, FLOW_HEIGHT_M)
            lines.points += [point(from_m), point(from_m + np.append(velocity, 0.0))]
            lines.colors += [new("std_msgs/ColorRGBA", *_flow_colour(velocity))] * 2
    return markers.message()


def _blank(stamped: Any, number: int, kind: int) -> Any:
    """Return a visualization_msgs/Marker at the origin of its frame, without size or colour."""
    return type_store().types["visualization_msgs/msg/Marker"](
        header=stamped,
        ns="",
        id=number,
        type=kind,
        action=ADD,
        pose=yaw_pose(np.zeros(3), 0.0),
        scale=vector(np.zeros(3)),
        color=new("std_msgs/ColorRGBA", 0.0, 0.0, 0.0, 0.0),
        lifetime=new("builtin_interfaces/Duration", 0, 0),
        frame_locked=False,
        points=[],
        colors=[],
        texture_resource="",
        texture=new("sensor_msgs/CompressedImage", header(0, ""), "", _NO_DATA),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=new("visualization_msgs/MeshFile", "", _NO_DATA),
        mesh_use_embedded_materials=False,
    )


def _colour(identity: int) -> Colour:
    """Return the colour of a track, which keeps it."""
    return Colour(*colorsys.hsv_to_rgb((identity * GOLDEN_RATIO) % 1.0, 0.7, 0.9))


def _flow_colour(velocity_mps: F32) -> Colour:
    """Return the colour of a velocity: its heading the hue, its speed the saturation."""
    x, y = (float(value) for value in velocity_mps)
    speed = min(1.0, float(np.hypot(x, y)) / FULL_COLOUR_MPS)
    hue = (float(np.arctan2(y, x)) / (2.0 * np.pi)) % 1.0
    return Colour(*colorsys.hsv_to_rgb(hue, speed, 0.9))
