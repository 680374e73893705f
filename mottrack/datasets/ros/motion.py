"""How the vehicle of a log moves, and where the other frames of the log are on it."""

from __future__ import annotations

from dataclasses import dataclass

from mottrack.core import Pose
from mottrack.core.errors import DataError
from mottrack.datasets.ros.config import RosConfig
from mottrack.datasets.ros.log import Log
from mottrack.datasets.ros.log_file import faults
from mottrack.datasets.ros.message_types import ODOMETRY_TYPES, TF_TYPES
from mottrack.datasets.ros.messages import odometry_poses
from mottrack.datasets.ros.trajectory import Trajectory
from mottrack.datasets.ros.transforms import Transforms, frame_name
from mottrack.formats.faults import MissingError

BASE_LINK = "base_link"
"""The vehicle's frame by REP 105."""


@dataclass(frozen=True)
class Motion:
    """The trajectory of the vehicle, and tf's tree of frames.

    trajectory: `world_T_ego`.
    world, ego: names of the two frames.
    transforms: all that tf publishes.
    mounting: of the points, where the settings give it.
    """

    trajectory: Trajectory
    world: str
    ego: str
    transforms: Transforms
    mounting: Pose | None

    def knows(self, frame: str) -> bool:
        """Return whether tf tells where a frame is on the vehicle."""
        return frame == self.ego or self.transforms.joined(self.ego, frame)

    def ego_T_points(self, frame: str, stamp_ns: int) -> Pose:
        """Return the mounting of a sensor: as configured, else by tf, else that of the vehicle."""
        if self.mounting is not None:
            return self.mounting
        return self._ego_T(frame, stamp_ns) if self.knows(frame) else Pose.identity()

    def world_T(self, frame: str, stamp_ns: int) -> Pose:
        """Return where a frame is in the world.

        Raises:
            KeyError: it is neither the world's, nor the vehicle's, nor one that tf joins to it.
        """
        if frame == self.world:
            return Pose.identity()
        if not self.knows(frame):
            raise KeyError(frame)
        # a message may be a little later than the last cloud, and than the last pose
        path = self.trajectory
        world_T_ego = path.at(min(max(stamp_ns, path.first_ns), path.last_ns))
        return world_T_ego if frame == self.ego else world_T_ego @ self._ego_T(frame, stamp_ns)

    def _ego_T(self, frame: str, stamp_ns: int) -> Pose:
        if frame == self.ego:
            return Pose.identity()
        return self.transforms.pose(self.ego, frame, stamp_ns)


def read_motion(log: Log, config: RosConfig) -> Motion:
    """Read poses and tf of a log.

    Raises:
        DataError: neither odometry nor tf, several topics to choose from, or damaged messages.
    """
    with faults(log.path):
        messages = [
            message
            for topic in config.tf_topics
            if topic in log.topics
            for message in log.messages(topic, TF_TYPES)
        ]
        transforms = Transforms(messages, log.path)
        topic = _odometry_topic(log, config, has_tf=bool(messages))
        if topic is None:
            return _by_tf(log, config, transforms)
        return _by_odometry(log, config, transforms, topic)


def _odometry_topic(log: Log, config: RosConfig, *, has_tf: bool) -> str | None:
    """Return the topic of poses; None where tf has them."""
    if config.poses == "tf":
        return None
    if config.odometry_topic is not None:
        return config.odometry_topic
    # a PoseStamped may be a goal or a marker's: one of an Odometry is of the vehicle
    topics = log.of_kind(ODOMETRY_TYPES[:1]) or log.of_kind(ODOMETRY_TYPES)
    if len(topics) == 1:
        return topics[0]
    if not topics and has_tf and config.poses == "auto":
        return None
    found = f"one of several: {', '.join(topics)}" if topics else "missing"
    expected = "dataset.odometry_topic=..., or dataset.poses=tf"
    others = ", ".join(sorted(log.topics)) or "none"
    raise DataError(log.path, "odometry", found, f"{expected} (topics: {others})")


def _by_odometry(log: Log, config: RosConfig, transforms: Transforms, topic: str) -> Motion:
    messages = log.messages(topic, ODOMETRY_TYPES)
    first = messages[0]
    child = frame_name(first.child_frame_id) if hasattr(first, "child_frame_id") else ""
    return Motion(
        Trajectory(odometry_poses(messages), log.path, config.max_gap_s),
        config.world_frame or frame_name(first.header.frame_id),
        config.ego_frame or child or BASE_LINK,
        transforms,
        _mounting(config),
    )


def _by_tf(log: Log, config: RosConfig, transforms: Transforms) -> Motion:
    ego = config.ego_frame or BASE_LINK
    if config.world_frame is None and transforms.root_of(ego) == ego:
        found = f"no transform above {ego}"
        raise MissingError(log.path, "tf", found, "dataset.ego_frame=<the vehicle's frame>")
    world = config.world_frame or transforms.root_of(ego)
    poses = transforms.poses(world, ego)
    trajectory = Trajectory(poses, log.path, config.max_gap_s)
    return Motion(trajectory, world, ego, transforms, _mounting(config))


def _mounting(config: RosConfig) -> Pose | None:
    if config.lidar_position_m is None and config.lidar_yaw_rad is None:
        return None
    return Pose.from_yaw(config.lidar_yaw_rad or 0.0, config.lidar_position_m or (0.0, 0.0, 0.0))
