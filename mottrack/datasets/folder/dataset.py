"""Recordings of one's own, one folder each."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

from mottrack.core import DataError, Frame, Sweep, TruthTable
from mottrack.datasets.detection_files import general_detections, located
from mottrack.datasets.folder.config import FolderConfig
from mottrack.datasets.folder.log_files import (
    is_lost,
    read_boxes_csv,
    read_detections_csv,
    read_poses_csv,
    read_sweep,
    sweep_file,
)
from mottrack.datasets.scene_boxes import DetectionTable, objects_of, truth_of
from mottrack.datasets.scene_frames import SceneFrames
from mottrack.datasets.scenes import checked_index, chosen_scenes, require_scene, scenes_in
from mottrack.datasets.vehicle import without_own_body
from mottrack.formats.files import existing_folder, present

POSES = "poses.csv"


class Folder:
    """The logs of a folder, in the format of docs/own_logs.md."""

    Config = FolderConfig
    name = "folder"

    def __init__(self, config: FolderConfig) -> None:
        self._config = config
        existing_folder(config.root, "root")

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen logs, or all folders with a poses.csv."""
        return chosen_scenes(self._config.scenes, scenes_in(self._config.root, f"*/{POSES}"))

    def scene(self, name: str) -> FolderScene:
        """Open one log.

        Raises:
            ConfigError: no log has that name.
            DataError: a file of it is missing or damaged.
        """
        require_scene(name, self.scene_names)
        return FolderScene(self._config.root / name, self._config)


class FolderScene:
    """A frame for each row of poses.csv; its token is the stamp."""

    def __init__(self, folder: Path, config: FolderConfig) -> None:
        self._folder, self._config = folder, config
        self._poses = read_poses_csv(folder / POSES)
        self._stamps = list(self._poses)
        if not self._stamps:
            raise DataError(folder / POSES, "rows", 0, "at least one pose")

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self._folder.name

    @property
    def classes(self) -> tuple[str, ...]:
        """The labels that are scored."""
        return self._config.classes

    @cached_property
    def has_sweeps(self) -> bool:
        """Whether any frame has a sweep; one that is missing then was lost."""
        return any(sweep_file(self._folder / "sweeps", stamp).is_file() for stamp in self._stamps)

    def __len__(self) -> int:
        return len(self._stamps)

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`, boxes in the world."""
        stamp_ns = self._stamp_ns(index)
        labelled = self._truth is not None and bool((self._truth.frame == index).any())
        return Frame(
            stamp_ns=stamp_ns,
            world_T_ego=self._poses[stamp_ns],
            detections=objects_of(self._detections, index, stamp_ns),
            truth=truth_of(self._truth, index, stamp_ns),
            is_key=labelled or self._config.key_frames == "all",
            token=str(stamp_ns),
        )

    def sweep(self, index: int) -> Sweep:
        """Return the sweep at `index`; without points if its file is missing or empty.

        Recorders lose single sweeps: `SceneWatch` counts them.

        Raises:
            DataError: the file is damaged, or there is no sweep at all.
        """
        stamp_ns = self._stamp_ns(index)
        path = sweep_file(self._folder / "sweeps", stamp_ns)
        pose, config = self._poses[stamp_ns], self._config
        if self.has_sweeps and is_lost(path):
            return Sweep.lost(stamp_ns, pose)
        read = read_sweep(path, stamp_ns, pose, config.lidar_origin_m)
        return without_own_body(read, config.vehicle)

    @property
    def detections_at(self) -> Path:
        """The log's file of detections."""
        if self._config.detections is not None:
            return located(self._config.root, self._config.detections)
        return self._folder / "detections.csv"

    def _stamp_ns(self, index: int) -> int:
        return self._stamps[checked_index(index, len(self), self.name)]

    @cached_property
    def _truth(self) -> TruthTable | None:
        path = self._folder / "boxes.csv"
        fitted = self._config.fitted_velocity
        return read_boxes_csv(path, self._poses, fitted=fitted) if present(path) else None

    @cached_property
    def _detections(self) -> DetectionTable | None:
        path = self.detections_at
        if self._config.detections is not None:
            names = tuple((str(stamp),) for stamp in self._stamps)
            poses = tuple(self._poses.values())
            frames = SceneFrames(self.name, names, tuple(self._stamps), poses)
            return general_detections(path, frames, self._config.detector)
        return read_detections_csv(path, self._poses) if present(path) else None
