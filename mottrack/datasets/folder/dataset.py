"""Logs of one's own, one folder each."""

from __future__ import annotations

from functools import cached_property

from mottrack.datasets.choice import chosen_scenes, require_scene
from mottrack.datasets.faults import MissingError
from mottrack.datasets.files import existing_folder
from mottrack.datasets.folder.config import FolderConfig
from mottrack.datasets.folder.scene import FolderScene


class Folder:
    """The logs of a folder, in the format of docs/own_logs.md."""

    Config = FolderConfig

    def __init__(self, config: FolderConfig) -> None:
        self._config = config
        existing_folder(config.root, "root")

    @property
    def name(self) -> str:
        """Name of the data set."""
        return "folder"

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen logs, or all folders with a poses.csv."""
        root = self._config.root
        present = tuple(sorted(path.parent.name for path in root.glob("*/poses.csv")))
        if not present:
            raise MissingError(root, "logs", "none", "<log>/poses.csv")
        return chosen_scenes(self._config.scenes, present)

    def scene(self, name: str) -> FolderScene:
        """Open one log.

        Raises:
            ConfigError: no log has that name.
            DataError: a file of it is missing or damaged.

        """
        require_scene(name, self.scene_names)
        return FolderScene(self._config.root / name, self._config)
