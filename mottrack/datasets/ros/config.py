"""Settings of ROS 2 logs."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.datasets.vehicle import VehicleOutline


class RosConfig(StrictModel):
    """Logs in mcap files, one scene each."""

    root: Path = Field(description="folder of mcap files")
    scenes: tuple[str, ...] | None = Field(None, description="file names without .mcap; none: all")
    points_topic: str = Field("/points", description="sensor_msgs/msg/PointCloud2")
    odometry_topic: str = Field("/odometry", description="nav_msgs/msg/Odometry")
    classes: tuple[str, ...] = Field(
        ("generic",), min_length=1, description="labels of the objects"
    )
    lidar_position_m: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="the points' frame in the ego frame of the odometry"
    )
    lidar_yaw_rad: float = Field(0.0, description="heading of the points' frame likewise")
    intensity_max: float = Field(255.0, gt=0, description="intensity that becomes reflectance 1")
    max_gap_s: float = Field(0.5, gt=0, description="longest odometry gap that is bridged")
    vehicle: VehicleOutline | None = Field(
        None, description="outline of your vehicle: points inside it are cut; null: none are"
    )
