"""One log of one's own."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

from mottrack.core import DataError, Frame, Sweep, TruthTable
from mottrack.datasets.folder.config import FolderConfig
from mottrack.datasets.folder.csv_files import read_boxes, read_detections, read_poses
from mottrack.datasets.folder.sweep_files import read_sweep, sweep_file
from mottrack.datasets.tables import DetectionTable, truth_of


class FolderScene:
    """A frame for each row of poses.csv; its token is the stamp."""

    def __init__(self, folder: Path, config: FolderConfig) -> None:
        self._folder, self._config = folder, config
        self._poses = read_poses(folder / "poses.csv")
        self._stamps = list(self._poses)
        if not self._stamps:
            raise DataError(folder / "poses.csv", "rows", 0, "at least one pose")

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
        """Whether every frame has a sweep."""
        return all(sweep_file(self._folder / "sweeps", stamp).is_file() for stamp in self._stamps)

    def __len__(self) -> int:
        return len(self._stamps)

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`, boxes in the world."""
        stamp_ns = self._stamps[index]
        truth, detections = self._truth, self._detections
        labelled = truth is not None and bool((truth.frame == index).any())
        return Frame(
            stamp_ns=stamp_ns,
            world_T_ego=self._poses[stamp_ns],
            detections=None if detections is None else detections.objects(index, stamp_ns),
            truth=None if truth is None else truth_of(truth, index, stamp_ns),
            is_key=labelled or self._config.key_frames == "all",
            token=str(stamp_ns),
        )

    def sweep(self, index: int) -> Sweep:
        """Return the sweep at `index`.

        Raises:
            DataError: the file is missing or damaged.

        """
        stamp_ns = self._stamps[index]
        path = sweep_file(self._folder / "sweeps", stamp_ns)
        return read_sweep(path, stamp_ns, self._poses[stamp_ns], self._config.lidar_origin_m)

    @property
    def detections_at(self) -> Path:
        """The log's file of detections."""
        return self._folder / "detections.csv"

    @cached_property
    def _truth(self) -> TruthTable | None:
        path = self._folder / "boxes.csv"
        return read_boxes(path, self._poses) if path.is_file() else None

    @cached_property
    def _detections(self) -> DetectionTable | None:
        path = self.detections_at
        return read_detections(path, self._poses) if path.is_file() else None
