"""Data sets of Autoware's T4 format: nuScenes' tables, one data set a scene."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

from mottrack.core.errors import DataError
from mottrack.datasets.nuscenes.config import T4Config
from mottrack.datasets.nuscenes.dataset import RecordStore, cache_dir, detection_file
from mottrack.datasets.nuscenes.detections import DetectionFile
from mottrack.datasets.nuscenes.dialect import T4 as DIALECT
from mottrack.datasets.nuscenes.scene import NuScenesScene, Source
from mottrack.datasets.scenes import chosen_scenes, require_scene
from mottrack.formats.faults import MissingError
from mottrack.formats.files import existing_folder, inside
from mottrack.formats.nuscenes_tables import NuScenesTables

TABLES = "annotation"
"""The folder of tables."""


class T4:
    """The data sets of a folder in Autoware's T4 format, a scene each.

    A scene has the name of its data set's folder; of several versions of it the highest is read.
    Maps, images and `lidarseg` are not needed.
    """

    Config = T4Config
    name = "t4"

    def __init__(self, config: T4Config) -> None:
        self._config = config
        existing_folder(config.root, "root")

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen data sets, or all.

        Raises:
            ConfigError: a chosen one is not there.
            DataError: there is none.
        """
        return chosen_scenes(self._config.scenes, tuple(self._folders))

    def scene(self, name: str) -> NuScenesScene:
        """Open one scene.

        Raises:
            ConfigError: no data set has that name.
            DataError: a table or the detection file is missing or damaged, or a data set holds
                several scenes.
        """
        require_scene(name, self.scene_names)
        folder = self._folders[name]
        tables = NuScenesTables(folder, TABLES)
        names = tuple(tables.scene_tokens())
        if len(names) != 1:
            raise DataError(tables.path("scene"), "scenes", len(names), "one (T4 format)")
        store = RecordStore(tables, names, DIALECT, cache_dir(self._config))
        source = Source(folder, self._config, DIALECT)
        return NuScenesScene(name, store.record(names[0]), source, self._detections)

    @cached_property
    def _folders(self) -> dict[str, Path]:
        """The folder that holds the tables, by name of the data set."""
        root = self._config.root
        if (root / TABLES).is_dir():
            return {root.resolve().name: root}
        found: dict[str, Path] = {}
        for pattern in (f"*/{TABLES}", f"*/*/{TABLES}"):
            # sorted by number of the version, the highest last
            for path in sorted(root.glob(pattern), key=lambda path: _number(path.parent.name)):
                parts = path.parent.relative_to(root).parts
                found[parts[0]] = inside(root, "/".join(parts), follow_links=True)
        if not found:
            expected = f"<data set>/{TABLES} or <data set>/<version>/{TABLES}"
            raise MissingError(root, "scenes", "none", expected)
        return dict(sorted(found.items()))

    @cached_property
    def _detections(self) -> DetectionFile | None:
        return detection_file(self._config, DIALECT)


def _number(version: str) -> tuple[int, str]:
    return (int(version) if version.isascii() and version.isdigit() else -1, version)
