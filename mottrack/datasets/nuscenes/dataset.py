"""nuScenes and TruckScenes data sets, read as they were downloaded."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path

from mottrack.core.errors import DataError, ResultError
from mottrack.datasets.detection_files import located
from mottrack.datasets.nuscenes.config import NuScenesConfig, TablesConfig, TruckScenesConfig
from mottrack.datasets.nuscenes.detections import DetectionFile
from mottrack.datasets.nuscenes.dialect import NUSCENES, TRUCKSCENES, Dialect
from mottrack.datasets.nuscenes.scene import NuScenesScene, Source
from mottrack.datasets.nuscenes.truckscenes_splits import resolve_truckscenes_split
from mottrack.datasets.scenes import chosen_scenes, require_scene
from mottrack.formats.cache import cache_folder, cache_key, is_large
from mottrack.formats.files import existing_folder, inside
from mottrack.formats.nuscenes_records import TABLES, SceneRecord, build_records
from mottrack.formats.nuscenes_splits import resolve_split
from mottrack.formats.nuscenes_tables import NuScenesTables, text_of


class SplitTables:
    """The scenes of one version and split, without the devkit.

    Of the tables only those that tracking needs are read, streamed, and of large ones an index
    is kept on disk, so that v1.0-trainval opens in seconds.
    """

    def __init__(
        self,
        config: NuScenesConfig | TruckScenesConfig,
        dialect: Dialect,
        scenes_of: Callable[[str], tuple[str, ...]],
    ) -> None:
        self._config, self._dialect, self._scenes_of = config, dialect, scenes_of
        existing_folder(config.root, "root")
        version = config.version or _version(config.root, config.split)
        inside(config.root, version, follow_links=True)
        self._tables = NuScenesTables(config.root, version)

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The scenes of the split that the tables hold, in the order of the tables.

        Raises:
            ConfigError: a chosen scene is not among them.
            DataError: none of the split's scenes is in the tables.
        """
        present = tuple(self._tables.scene_tokens())
        if self._config.split is not None:
            wanted = set(self._scenes_of(self._config.split))
            here = tuple(name for name in present if name in wanted)
            if not here:
                path = self._tables.path("scene")
                found = f"others ({len(present)})"
                raise DataError(path, "scenes", found, f"scenes of split {self._config.split}")
            present = here
        return chosen_scenes(self._config.scenes, present)

    def scene(self, name: str) -> NuScenesScene:
        """Open one scene.

        Raises:
            ConfigError: no scene has that name.
            DataError: a table or the detection file is missing or damaged.
        """
        require_scene(name, self.scene_names)
        source = Source(self._config.root, self._config, self._dialect)
        return NuScenesScene(name, self._store.record(name), source, self._detections)

    def sample_tokens(self) -> list[str]:
        """Return the key frames of all scenes, as a submission must have them."""
        records = (self._store.record(name) for name in self.scene_names)
        return [token for record in records for token in text_of(record.sample_token)]

    @cached_property
    def _store(self) -> RecordStore:
        folder = cache_dir(self._config)
        store = RecordStore(self._tables, self.scene_names, self._dialect, folder)
        store.prepare()
        return store

    @cached_property
    def _detections(self) -> DetectionFile | None:
        return detection_file(self._config, self._dialect)


class NuScenes(SplitTables):
    """The scenes of one version and split, without the devkit."""

    Config = NuScenesConfig
    name = "nuscenes"

    def __init__(self, config: NuScenesConfig) -> None:
        super().__init__(config, NUSCENES, resolve_split)


class TruckScenes(SplitTables):
    """The scenes of one version and split of MAN TruckScenes, six LiDARs in one sweep."""

    Config = TruckScenesConfig
    name = "truckscenes"

    def __init__(self, config: TruckScenesConfig) -> None:
        super().__init__(config, TRUCKSCENES, resolve_truckscenes_split)


def detection_file(config: TablesConfig, dialect: Dialect) -> DetectionFile | None:
    """Return the configured file of detections, if there is one."""
    if config.detections is None:
        return None
    path = located(config.root, config.detections)
    return DetectionFile(path, cache_dir(config), dialect)


def cache_dir(config: TablesConfig) -> Path | None:
    """Return where indexes of large files are kept; None: nowhere."""
    return cache_folder(config.cache_dir) if config.cache else None


def _version(root: Path, split: str | None) -> str:
    """Return the folder of tables that a split belongs to, or the only one there is."""
    present = sorted(path.name for path in root.glob("v1.*-*") if path.is_dir())
    suffix = {"train": "trainval", "val": "trainval", "test": "test"}.get(split or "", "mini")
    official = [name for name in present if name.endswith(f"-{suffix}")]
    if len(present) == 1:
        return present[0]
    if split is not None and len(official) == 1:
        return official[0]
    found = ", ".join(present) or "none"
    raise DataError(root, "version", f"not chosen (here: {found})", "dataset.version=v1.0-...")


class RecordStore:
    """Gives the record of a scene; the first request reads the tables of all chosen scenes.

    With `cache_dir` None nothing is kept on disk.
    """

    def __init__(
        self,
        tables: NuScenesTables,
        names: tuple[str, ...],
        dialect: Dialect,
        cache_dir: Path | None,
    ) -> None:
        self._tables, self._names, self._dialect = tables, names, dialect
        self._folder = self._index_folder(cache_dir)
        self._records: dict[str, SceneRecord] = {}

    def prepare(self) -> None:
        """Read large tables now unless every scene is indexed, so that workers need not."""
        folder = self._folder
        if folder is not None and not all(_entry(folder, n).is_file() for n in self._names):
            self._build(folder)

    def record(self, name: str) -> SceneRecord:
        """Return the record of one of the chosen scenes."""
        if self._folder is not None:
            return self._from_disk(self._folder, name)
        if not self._records:
            self._records = self._read()
        return self._records[name]

    def _read(self) -> dict[str, SceneRecord]:
        return build_records(self._tables, self._names, channels=self._dialect.channels)

    def _index_folder(self, cache_dir: Path | None) -> Path | None:
        paths = [self._tables.path(name) for name in TABLES]
        if cache_dir is None or not is_large(paths):
            return None
        return cache_dir / f"nuscenes-{cache_key(paths)}"

    def _from_disk(self, folder: Path, name: str) -> SceneRecord:
        try:
            return SceneRecord.load(_entry(folder, name))
        except ResultError:
            return self._build(folder)[name]

    def _build(self, folder: Path) -> dict[str, SceneRecord]:
        records = self._read()
        try:
            for name, record in records.items():
                record.save(_entry(folder, name))
        except OSError:
            # a cache that can't be written is done without
            self._folder, self._records = None, records
        return records


def _entry(folder: Path, name: str) -> Path:
    # the name comes from a table
    return inside(folder, f"{name}.npz")
