"""Scene records: made from the tables at once, kept in memory or, for large sets, on disk."""

from __future__ import annotations

from pathlib import Path

from mottrack.core.errors import ResultError
from mottrack.datasets.nuscenes.records import TABLES, SceneRecord, build_records
from mottrack.formats.cache import cache_key, is_large
from mottrack.formats.files import inside
from mottrack.formats.nuscenes_tables import NuScenesTables


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
