"""ROS 2 logs of a folder."""

from __future__ import annotations

from functools import cached_property

from mottrack.datasets.choice import chosen_scenes, require_scene
from mottrack.datasets.faults import MissingError
from mottrack.datasets.files import existing_folder, inside
from mottrack.datasets.ros.config import RosConfig
from mottrack.datasets.ros.scene import RosScene


class RosLogs:
    """The mcap files of a folder, a scene each: PointCloud2 for sweeps, Odometry for poses."""

    Config = RosConfig

    def __init__(self, config: RosConfig) -> None:
        self._config = config
        existing_folder(config.root, "root")

    @property
    def name(self) -> str:
        """Name of the data set."""
        return "ros"

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen files, or all."""
        present = tuple(sorted(path.stem for path in self._config.root.glob("*.mcap")))
        if not present:
            raise MissingError(self._config.root, "logs", "none", "*.mcap")
        return chosen_scenes(self._config.scenes, present)

    def scene(self, name: str) -> RosScene:
        """Open one log.

        Raises:
            ConfigError: no log has that name.
            DataError: the file is damaged, or lacks a topic or a pose.

        """
        require_scene(name, self.scene_names)
        return RosScene(inside(self._config.root, f"{name}.mcap", follow_links=True), self._config)
