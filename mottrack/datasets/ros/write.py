"""Write any scenes as ROS 2 logs, one mcap file each."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from mottrack.core import Frame, Objects, Pose, Scene, Sweep, Truth
from mottrack.datasets.ros.mcap_writer import McapWriter, new_mcap
from mottrack.datasets.ros.new_messages import (
    box_of,
    detection,
    header,
    new,
    odometry,
    point_cloud,
    transform,
    xyz_columns,
)

POINTS, ODOMETRY, TF, TF_STATIC = "/points", "/odometry", "/tf", "/tf_static"
DETECTIONS, TRUTH = "/detections", "/truth"
WORLD, EGO, LIDAR = "map", "base_link", "lidar"
"""Names of the frames, by REP 105."""
INTENSITY_MAX = 255.0
"""The reader's default for reflectance 1."""


def write_ros(scenes: Iterable[Scene], root: Path) -> tuple[str, ...]:
    """Write `<scene>.mcap` for each scene; return the names.

    Topics: `/points` (`t` in nanoseconds from the stamp, `ring`), `/odometry`,
    `/tf`, `/tf_static`, and as vision_msgs/Detection3DArray `/detections` and `/truth`, which
    holds the identity in `id`.
    """
    names = []
    for scene in scenes:
        with new_mcap(root / f"{scene.name}.mcap") as log:
            _write_scene(log, scene)
        names.append(scene.name)
    return tuple(names)


def _write_scene(log: McapWriter, scene: Scene) -> None:
    for index in range(len(scene)):
        frame = scene.frame(index)
        stamp_ns, pose = frame.stamp_ns, frame.world_T_ego
        log.add(TF, stamp_ns, transform(stamp_ns, WORLD, EGO, pose))
        log.add(ODOMETRY, stamp_ns, odometry(stamp_ns, WORLD, EGO, pose))
        if scene.has_sweeps:
            sweep = scene.sweep(index)
            mounting = Pose(np.eye(3), sweep.origin_m)
            if index == 0:
                log.add(TF_STATIC, stamp_ns, transform(stamp_ns, EGO, LIDAR, mounting))
            _add_points(log, sweep, mounting)
        for topic, boxes in ((DETECTIONS, frame.detections), (TRUTH, frame.truth)):
            if boxes is not None:
                _add_boxes(log, topic, frame, boxes)


def _add_points(log: McapWriter, sweep: Sweep, mounting: Pose) -> None:
    columns = xyz_columns(mounting.inverse().apply(sweep.xyz_m).astype(np.float32))
    columns["intensity"] = (sweep.reflectance * INTENSITY_MAX).astype(np.float32)
    if sweep.ring is not None:
        columns["ring"] = sweep.ring.astype(np.uint16)
    if sweep.time_offset_ns is not None:
        columns["t"] = sweep.time_offset_ns.astype(np.int32)
    log.add(POINTS, sweep.stamp_ns, point_cloud(sweep.stamp_ns, LIDAR, columns))


def _add_boxes(log: McapWriter, topic: str, frame: Frame, boxes: Objects | Truth) -> None:
    stamped = header(frame.stamp_ns, WORLD)
    found = []
    for row in range(len(boxes)):
        box = box_of(boxes.centre_m[row], boxes.size_m[row], boxes.yaw_rad[row])
        score = float(boxes.score[row]) if isinstance(boxes, Objects) else 1.0
        name = "" if isinstance(boxes, Objects) else str(boxes.id[row])
        found.append(detection(stamped, str(boxes.label[row]), score, box, name))
    log.add(topic, frame.stamp_ns, new("vision_msgs/Detection3DArray", stamped, found))
