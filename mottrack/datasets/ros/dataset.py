"""ROS 2 logs of a folder."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from mottrack.core import Frame, Pose, Sweep
from mottrack.datasets.ros.config import RosConfig
from mottrack.datasets.ros.mcap_file import McapFile, MessageTime
from mottrack.datasets.ros.message_types import ODOMETRY_TYPES, POINT_TYPES
from mottrack.datasets.ros.messages import Odometry, point_columns
from mottrack.datasets.scenes import checked_index, chosen_scenes, require_scene, scenes_in
from mottrack.datasets.vehicle import without_own_body
from mottrack.formats.checks import check_points, check_rings
from mottrack.formats.faults import OutOfOrderError
from mottrack.formats.files import existing_folder, inside


class RosLogs:
    """The mcap files of a folder, a scene each: PointCloud2 for sweeps, Odometry for poses."""

    Config = RosConfig
    name = "ros"

    def __init__(self, config: RosConfig) -> None:
        self._config = config
        existing_folder(config.root, "root")

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen files, or all."""
        return chosen_scenes(self._config.scenes, scenes_in(self._config.root, "*.mcap"))

    def scene(self, name: str) -> RosScene:
        """Open one log.

        Raises:
            ConfigError: no log has that name.
            DataError: the file is damaged, or lacks a topic or a pose.
        """
        require_scene(name, self.scene_names)
        return RosScene(inside(self._config.root, f"{name}.mcap", follow_links=True), self._config)


class RosScene:
    """A frame for each point cloud, at the stamp in its header; no truth, no detections."""

    has_sweeps = True

    def __init__(self, path: Path, config: RosConfig) -> None:
        self._path, self._config = path, config
        self._file = McapFile(path)
        self._times = sorted(
            self._file.times(config.points_topic, POINT_TYPES), key=lambda t: t.stamp_ns
        )
        stamps = [time.stamp_ns for time in self._times]
        if len(set(stamps)) != len(stamps):
            raise OutOfOrderError(path, config.points_topic, "a stamp twice", "each stamp once")
        messages = self._file.messages(config.odometry_topic, ODOMETRY_TYPES)
        odometry = Odometry(messages, path, config.max_gap_s)
        self._poses = [odometry.at(stamp) for stamp in stamps]

    @property
    def name(self) -> str:
        """Name of the file."""
        return self._path.stem

    @property
    def classes(self) -> tuple[str, ...]:
        """The labels of the objects."""
        return self._config.classes

    def __len__(self) -> int:
        return len(self._times)

    @property
    def detections_at(self) -> Path:
        """The log itself, which holds none."""
        return self._path

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`."""
        stamp_ns = self._time(index).stamp_ns
        return Frame(stamp_ns=stamp_ns, world_T_ego=self._poses[index], token=str(stamp_ns))

    def sweep(self, index: int) -> Sweep:
        """Return the point cloud at `index` in the ego frame.

        Raises:
            DataError: the message is damaged.
        """
        time = self._time(index)
        columns = point_columns(self._file.message(self._config.points_topic, time), self._path)
        xyz_m = np.column_stack([columns[axis].astype(np.float64) for axis in "xyz"])
        check_points(self._path, xyz_m)
        intensity = columns.get("intensity", np.zeros(len(xyz_m))).astype(np.float32)
        mounting = Pose.from_yaw(self._config.lidar_yaw_rad, self._config.lidar_position_m)
        read = Sweep(
            xyz_m=mounting.apply(xyz_m).astype(np.float32),
            reflectance=np.clip(np.nan_to_num(intensity) / self._config.intensity_max, 0.0, 1.0),
            stamp_ns=time.stamp_ns,
            world_T_ego=self._poses[index],
            origin_m=mounting.translation_m,
            ring=check_rings(self._path, columns["ring"]) if "ring" in columns else None,
        )
        return without_own_body(read, self._config.vehicle)

    def _time(self, index: int) -> MessageTime:
        return self._times[checked_index(index, len(self), self.name)]
