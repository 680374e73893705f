"""Logs of ROS 2 and ROS 1."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from mottrack.core import Frame, Sweep, TruthTable
from mottrack.core.concerns import Concern
from mottrack.core.errors import DataError, InputError
from mottrack.core.objects import GENERIC
from mottrack.datasets.ros.box_messages import BoxReader, MessageBoxes
from mottrack.datasets.ros.clouds import Clouds, cloud_topics
from mottrack.datasets.ros.config import RosConfig
from mottrack.datasets.ros.log import METADATA, SUFFIXES, open_log
from mottrack.datasets.ros.log_file import faults
from mottrack.datasets.ros.message_types import BOX_TYPES
from mottrack.datasets.ros.motion import read_motion
from mottrack.datasets.scene_boxes import DetectionTable, objects_of, truth_of
from mottrack.datasets.scenes import checked_index, chosen_scenes, require_scene
from mottrack.datasets.vehicle import without_own_body
from mottrack.formats.faults import MissingError
from mottrack.formats.files import existing_folder, inside


class RosLogs:
    """The logs of a folder, a scene each: point clouds, poses, detections."""

    Config = RosConfig
    name = "ros"

    def __init__(self, config: RosConfig) -> None:
        self._config = config
        existing_folder(config.root, "root")

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen logs, or all.

        Raises:
            ConfigError: a chosen log is not there.
            DataError: there is none, or two have the same name.
        """
        return chosen_scenes(self._config.scenes, tuple(self._paths))

    def scene(self, name: str) -> RosScene:
        """Open one log.

        Raises:
            ConfigError: no log has that name.
            DataError: the file is damaged, lacks a topic, or has odometry for no point cloud.
        """
        require_scene(name, self.scene_names)
        return RosScene(name, self._paths[name], self._config)

    @cached_property
    def _paths(self) -> dict[str, Path]:
        """Each log by name: bag folders, and single files; the root itself if it is a bag."""
        root = self._config.root
        if (root / METADATA).is_file():
            return {root.resolve().name: root}
        paths = [path.parent for path in root.glob(f"*/{METADATA}")]
        for suffix in SUFFIXES:
            paths += root.glob(f"*{suffix}")
        found: dict[str, Path] = {}
        for path in sorted(paths):
            name = path.name if path.is_dir() else path.stem
            if name in found:
                raise DataError(path, "name of a log", f"that of {found[name].name}", "another")
            found[name] = inside(root, path.name, follow_links=True)
        if not found:
            endings = ", ".join(f"<scene>{suffix}" for suffix in SUFFIXES)
            raise MissingError(root, "scenes", "none", f"{endings} or <scene>/{METADATA}")
        return found


class RosScene:
    """A frame for each point cloud, or, in a log without points, for each message of detections.

    The token is the stamp. Clouds before the first and after the last pose are left out. With a
    topic of detections, key frames are those with a message.
    """

    def __init__(self, name: str, path: Path, config: RosConfig) -> None:
        self._name, self._path, self._config = name, path, config
        self._log = open_log(path)
        self._motion = read_motion(self._log, config)
        topics = cloud_topics(self._log, config)
        self._clouds = Clouds(self._log, config, self._motion, topics) if topics else None
        self._stamps = self._clouds.stamps_ns if self._clouds else self._detection_stamps()
        self._poses = [self._motion.trajectory.at(stamp) for stamp in self._stamps]

    @property
    def name(self) -> str:
        """Name of the file or folder."""
        return self._name

    @property
    def has_sweeps(self) -> bool:
        """Whether the log holds point clouds."""
        return self._clouds is not None

    @cached_property
    def classes(self) -> tuple[str, ...]:
        """The labels of the objects: as configured, else those of the detections or labels."""
        if self._config.classes is not None:
            return self._config.classes
        boxes = [b.label for b in (self._detected, self._labelled) if b is not None]
        return tuple(np.unique(np.concatenate(boxes)).tolist()) if boxes else (GENERIC,)

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def detections_at(self) -> Path:
        """The log itself."""
        return self._path

    @property
    def concerns(self) -> tuple[Concern, ...]:
        """What was left out or assumed."""
        found = [] if self._clouds is None else self._clouds.concerns()
        for what, boxes in (("detections", self._detected), ("labels", self._labelled)):
            if boxes is not None and boxes.unmatched and not self._expected(boxes):
                text = f"others are nearer, or no frame is within {self._config.match_s:g} s"
                found.append(Concern(f"messages of {what} left out", boxes.unmatched, text))
        return tuple(found)

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`, boxes in the world.

        Raises:
            DataError: a message is damaged, or in a frame that tf does not place.
        """
        stamp_ns = self._stamps[checked_index(index, len(self), self.name)]
        detected = self._detected is None or index in self._detected.seen
        labelled = self._labelled is not None and index in self._labelled.seen
        return Frame(
            stamp_ns=stamp_ns,
            world_T_ego=self._poses[index],
            detections=objects_of(
                self._detections if detected else None,
                index,
                stamp_ns,
                velocities=self._config.detector_velocity,
            ),
            truth=truth_of(self._truth if labelled else None, index, stamp_ns),
            is_key=detected,
            token=str(stamp_ns),
        )

    def sweep(self, index: int) -> Sweep:
        """Return the point cloud at `index` in the ego frame; one may be without points.

        Raises:
            DataError: the message is damaged.
            InputError: the log holds no point clouds.
        """
        checked_index(index, len(self), self.name)
        if self._clouds is None:
            raise InputError("sweep", index, f"a log with point clouds; {self._path} has none")
        return without_own_body(self._clouds.sweep(index), self._config.vehicle)

    def _detection_stamps(self) -> list[int]:
        topic = str(self._config.detections_topic)
        stamps = sorted({time.stamp_ns for time in self._log.times(topic, BOX_TYPES)})
        path = self._motion.trajectory
        kept = [stamp for stamp in stamps if path.first_ns <= stamp <= path.last_ns]
        if not kept:
            raise MissingError(self._path, "frames", "none", "detections during the poses")
        return kept

    def _expected(self, boxes: MessageBoxes) -> bool:
        """Return whether no more messages are unmatched than clouds were left out at the ends."""
        return self._clouds is not None and boxes.unmatched <= self._clouds.left_out

    @cached_property
    def _detected(self) -> MessageBoxes | None:
        return self._boxes(self._config.detections_topic)

    @cached_property
    def _labelled(self) -> MessageBoxes | None:
        return self._boxes(self._config.truth_topic)

    def _boxes(self, topic: str | None) -> MessageBoxes | None:
        if topic is None:
            return None
        messages = self._log.messages(topic, BOX_TYPES)
        with faults(self._path):
            reader = BoxReader(self._path, self._motion, self._stamps, self._config.match_s)
            return reader.read(messages, self._config.class_map)

    @cached_property
    def _detections(self) -> DetectionTable | None:
        if self._detected is None:
            return None
        table = self._detected.detections()
        return table.select(np.isin(table.label, self.classes))

    @cached_property
    def _truth(self) -> TruthTable | None:
        if self._labelled is None:
            return None
        return self._labelled.truth(self._stamps, fitted=self._config.fitted_velocity)
