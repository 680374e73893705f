"""One ROS 2 log."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mottrack.core import DataError, Frame, Pose, Sweep
from mottrack.datasets.faults import OutOfOrderError
from mottrack.datasets.files import check_range
from mottrack.datasets.ros.config import RosConfig
from mottrack.datasets.ros.mcap_file import McapFile
from mottrack.datasets.ros.odometry import Odometry
from mottrack.datasets.ros.point_cloud import point_columns


class RosScene:
    """A frame for each point cloud, at the stamp in its header; no truth, no detections."""

    has_sweeps = True

    def __init__(self, path: Path, config: RosConfig) -> None:
        self._path, self._config = path, config
        self._file = McapFile(path)
        self._places = sorted(self._file.places(config.points_topic), key=lambda p: p.stamp_ns)
        stamps = [place.stamp_ns for place in self._places]
        if len(set(stamps)) != len(stamps):
            raise OutOfOrderError(path, config.points_topic, "a stamp twice", "each stamp once")
        messages = self._file.messages(config.odometry_topic)
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
        return len(self._places)

    @property
    def detections_at(self) -> Path:
        """The log itself, which holds none."""
        return self._path

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`."""
        stamp_ns = self._places[index].stamp_ns
        return Frame(stamp_ns=stamp_ns, world_T_ego=self._poses[index], token=str(stamp_ns))

    def sweep(self, index: int) -> Sweep:
        """Return the point cloud at `index` in the ego frame.

        Raises:
            DataError: the message is damaged.

        """
        place = self._places[index]
        columns = point_columns(self._file.message(self._config.points_topic, place), self._path)
        xyz = np.column_stack([columns[axis].astype(np.float64) for axis in "xyz"])
        if not len(xyz):
            raise DataError(self._path, f"cloud at {place.stamp_ns}", "empty", "points")
        check_range(self._path, xyz)
        intensity = columns.get("intensity", np.zeros(len(xyz))).astype(np.float32)
        mounting = Pose.from_yaw(self._config.lidar_yaw_rad, self._config.lidar_position_m)
        return Sweep(
            xyz_m=mounting.apply(xyz).astype(np.float32),
            reflectance=np.clip(np.nan_to_num(intensity) / self._config.intensity_max, 0.0, 1.0),
            stamp_ns=place.stamp_ns,
            world_T_ego=self._poses[index],
            origin_m=mounting.translation_m,
            ring=columns["ring"].astype(np.int16) if "ring" in columns else None,
        )
