"""A nuScenes data set, read as it was downloaded."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

from mottrack.core.errors import DataError, ResultError
from mottrack.datasets.detection_files import located
from mottrack.datasets.nuscenes.config import NuScenesConfig
from mottrack.datasets.nuscenes.detections import DetectionFile
from mottrack.datasets.nuscenes.scene import NuScenesScene
from mottrack.datasets.scenes import chosen_scenes, require_scene
from mottrack.formats.cache import cache_folder, cache_key, is_large
from mottrack.formats.files import existing_folder, inside
from mottrack.formats.nuscenes_records import TABLES, SceneRecord, build_records
from mottrack.formats.nuscenes_splits import resolve_split
from mottrack.formats.nuscenes_tables import NuScenesTables, text_of


class NuScenes:
    """The scenes of one version and split, without the devkit.

    Of the tables only those that tracking needs are read, streamed, and of large ones an index
    is kept on disk, so that v1.0-trainval opens in seconds.
    """

    Config = NuScenesConfig
    name = "nuscenes"

    def __init__(self, config: NuScenesConfig) -> None:
        self._config = config
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
            wanted = set(resolve_split(self._config.split))
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
        return NuScenesScene(name, self._store.record(name), self._config, self._detections)

    def sample_tokens(self) -> list[str]:
        """Return the key frames of all scenes, as a submission must have them."""
        records = (self._store.record(name) for name in self.scene_names)
        return [token for record in records for token in text_of(record.sample_token)]

    @cached_property
    def _store(self) -> RecordStore:
        store = RecordStore(self._tables, self.scene_names, self._cache_dir)
        store.prepare()
        return store

    @cached_property
    def _detections(self) -> DetectionFile | None:
        if self._config.detections is None:
            return None
        path = located(self._config.root, self._config.detections)
        return DetectionFile(path, self._cache_dir)

    @property
    def _cache_dir(self) -> Path | None:
        return cache_folder(self._config.cache_dir) if self._config.cache else None


def _version(root: Path, split: str | None) -> str:
    """Return the folder of tables that a split belongs to, or the only one there is."""
    present = sorted(path.name for path in root.glob("v1.0-*") if path.is_dir())
    suffix = {"train": "trainval", "val": "trainval", "test": "test"}.get(split or "", "mini")
    official = f"v1.0-{suffix}"
    if len(present) == 1:
        return present[0]
    if split is not None and official in present:
        return official
    found = ", ".join(present) or "none"
    raise DataError(root, "version", f"not chosen (here: {found})", "dataset.version=v1.0-...")


class RecordStore:
    """Gives the record of a scene; the first request reads the tables of all chosen scenes.

    With `cache_dir` None nothing is kept on disk.
    """

    def __init__(
        self, tables: NuScenesTables, names: tuple[str, ...], cache_dir: Path | None
    ) -> None:
        self._tables, self._names = tables, names
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
            self._records = build_records(self._tables, self._names)
        return self._records[name]

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
        records = build_records(self._tables, self._names)
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
