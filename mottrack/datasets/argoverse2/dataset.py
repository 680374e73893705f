"""An Argoverse 2 sensor data set, read as it was downloaded."""

from __future__ import annotations

from functools import cached_property

from mottrack.datasets.argoverse2.config import Argoverse2Config
from mottrack.datasets.argoverse2.scene import Argoverse2Scene
from mottrack.datasets.choice import chosen_scenes, require_scene
from mottrack.datasets.faults import MissingError
from mottrack.datasets.files import existing_folder, inside


class Argoverse2:
    """The logs of one split."""

    Config = Argoverse2Config

    def __init__(self, config: Argoverse2Config) -> None:
        self._config = config
        self._folder = existing_folder(
            inside(config.root, config.split, follow_links=True), "split"
        )

    @property
    def name(self) -> str:
        """Name of the data set."""
        return "argoverse2"

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen logs, or all folders that hold ego poses."""
        poses = self._folder.glob("*/city_SE3_egovehicle.feather")
        present = tuple(sorted(path.parent.name for path in poses))
        if not present:
            raise MissingError(self._folder, "logs", "none", "<log>/city_SE3_egovehicle.feather")
        return chosen_scenes(self._config.scenes, present)

    def scene(self, name: str) -> Argoverse2Scene:
        """Open one log.

        Raises:
            ConfigError: no log has that name.
            DataError: a file of it is missing or damaged.

        """
        require_scene(name, self.scene_names)
        return Argoverse2Scene(self._folder / name, self._config)
