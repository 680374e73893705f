"""Settings of logs of ROS."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.datasets.vehicle import VehicleOutline


class RosConfig(StrictModel):
    """Logs of ROS 2 and ROS 1, one scene each."""

    root: Path = Field(description="folder of logs, or one bag folder with `metadata.yaml`")
    scenes: tuple[str, ...] | None = Field(
        None, description="names of bag folders, or of files without their ending; none: all"
    )
    points_topic: str | tuple[str, ...] | None = Field(
        None,
        description="sensor_msgs/msg/PointCloud2, or several, merged at the stamps of the first; "
        "none: the only one there is",
    )
    poses: Literal["auto", "odometry", "tf"] = Field(
        "auto", description="where poses of the vehicle come from; auto: odometry, else tf"
    )
    odometry_topic: str | None = Field(
        None,
        description="nav_msgs/msg/Odometry, PoseStamped or PoseWithCovarianceStamped; "
        "none: the only one there is",
    )
    tf_topics: tuple[str, ...] = Field(
        ("/tf", "/tf_static"), description="tf2_msgs/msg/TFMessage; those that are there are read"
    )
    world_frame: str | None = Field(
        None, description="the world's frame in tf; none: the uppermost above the vehicle's"
    )
    ego_frame: str | None = Field(
        None, description="the vehicle's frame; none: the odometry's child, `base_link` for tf"
    )
    detections_topic: str | None = Field(
        None,
        description="vision_msgs/msg/Detection3DArray, or DetectedObjects or TrackedObjects of "
        "Autoware; key frames are then those with a message",
    )
    truth_topic: str | None = Field(
        None, description="labelled boxes, of the same types, with the identity in `id`"
    )
    match_s: float = Field(
        0.05, gt=0, le=1.0, description="longest time between a cloud and what belongs to it"
    )
    class_map: dict[str, str] = Field(
        {}, description="class of a detection to label; others keep their name in lower case"
    )
    classes: tuple[str, ...] | None = Field(
        None,
        min_length=1,
        description="labels of the objects, detections of others are left out; none: those that "
        "occur, `generic` without detections",
    )
    detector_velocity: bool = Field(
        False, description="use the detector's own velocities (Autoware's twist) as measurements"
    )
    motion_compensation: bool = Field(
        False, description="points are as measured: move each to the stamp by its own time"
    )
    lidar_position_m: tuple[float, float, float] | None = Field(
        None, description="the points' frame in the vehicle's; none: by tf, else the same frame"
    )
    lidar_yaw_rad: float | None = Field(
        None, description="heading of the points' frame in the vehicle's, likewise"
    )
    intensity_max: float = Field(255.0, gt=0, description="intensity that becomes reflectance 1")
    max_gap_s: float = Field(0.5, gt=0, description="longest gap between poses that is bridged")
    fitted_velocity: bool = Field(
        True, description="true velocities: a robust fit over 0.6 s, else differences of boxes"
    )
    vehicle: VehicleOutline | None = Field(
        None, description="outline of your vehicle: points inside it are cut; null: none are"
    )
