"""An Argoverse 2 sensor data set, read as it was downloaded."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from mottrack.core import DataError, Frame, Sweep, TruthTable
from mottrack.core.arrays import F64
from mottrack.datasets.argoverse2.config import CLASSES, Argoverse2Config
from mottrack.datasets.argoverse2.ground_height import GroundHeight, read_ground_height
from mottrack.datasets.argoverse2.log_files import (
    annotation_stamps,
    read_annotations,
    read_lidar_origin,
    read_log_detections,
    read_poses,
    read_sweep,
    sweep_stamps,
)
from mottrack.datasets.detection_files import general_detections, is_general, located, relabelled
from mottrack.datasets.scene_boxes import DetectionTable, objects_of, truth_of
from mottrack.datasets.scene_frames import SceneFrames
from mottrack.datasets.scenes import (
    SWEEP_OR_OPTION,
    checked_index,
    chosen_scenes,
    require_scene,
    scenes_in,
)
from mottrack.datasets.vehicle import without_own_body
from mottrack.formats.faults import MissingError
from mottrack.formats.files import existing_folder, inside, present

ANNOTATIONS = "annotations.feather"
POSES = "city_SE3_egovehicle.feather"


class Argoverse2:
    """The logs of one split."""

    Config = Argoverse2Config
    name = "argoverse2"

    def __init__(self, config: Argoverse2Config) -> None:
        self._config = config
        self._folder = existing_folder(
            inside(config.root, config.split, follow_links=True), "split"
        )

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen logs, or all folders that hold ego poses."""
        return chosen_scenes(self._config.scenes, scenes_in(self._folder, f"*/{POSES}"))

    def scene(self, name: str) -> Argoverse2Scene:
        """Open one log.

        Raises:
            ConfigError: no log has that name.
            DataError: a file of it is missing or damaged.
        """
        require_scene(name, self.scene_names)
        return Argoverse2Scene(self._folder / name, self._config)


class Argoverse2Scene:
    """Frames of one log at 10 Hz, each a key frame; the token is the stamp in nanoseconds.

    There is a frame at every time that has a sweep or annotations. The world is the city frame.
    """

    classes = CLASSES

    def __init__(self, folder: Path, config: Argoverse2Config) -> None:
        self._folder, self._config = folder, config
        self._sweep_stamps = frozenset(sweep_stamps(folder / "sensors" / "lidar"))
        self._stamps = self._frame_stamps()
        self._poses = read_poses(folder / POSES, self._stamps)

    @property
    def name(self) -> str:
        """Name of the log."""
        return self._folder.name

    @property
    def has_sweeps(self) -> bool:
        """Whether every frame has a sweep."""
        return self._sweep_stamps.issuperset(self._stamps)

    def __len__(self) -> int:
        return len(self._stamps)

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`, boxes in the world."""
        stamp_ns = self._stamp_ns(index)
        return Frame(
            stamp_ns=stamp_ns,
            world_T_ego=self._poses.frames[stamp_ns],
            detections=objects_of(self._detections, index, stamp_ns),
            truth=truth_of(self._truth, index, stamp_ns),
            token=str(stamp_ns),
        )

    def sweep(self, index: int) -> Sweep:
        """Return the sweep at `index`.

        Raises:
            DataError: the file is missing or damaged.
        """
        stamp_ns = self._stamp_ns(index)
        path = self._folder / "sensors" / "lidar" / f"{stamp_ns}.feather"
        if not present(path):
            raise MissingError(path, "sweep", "missing", SWEEP_OR_OPTION)
        read = read_sweep(path, stamp_ns, self._poses.frames[stamp_ns], self._origin_m)
        return without_own_body(read, self._config.vehicle)

    def ground_height(self, xy_m: F64) -> F64:
        """Return the map's height (N,) in metres at (N, 2) places of the world; NaN: unknown."""
        return np.full(len(xy_m), np.nan) if self._ground is None else self._ground.at(xy_m)

    @property
    def detections_at(self) -> Path:
        """The file of detections; the root where none was named."""
        root, path = self._config.root, self._config.detections
        return root if path is None else located(root, path)

    @property
    def _annotation_file(self) -> Path:
        return self._folder / ANNOTATIONS

    def _stamp_ns(self, index: int) -> int:
        return self._stamps[checked_index(index, len(self), self.name)]

    def _frame_stamps(self) -> list[int]:
        stamps = set(self._sweep_stamps)
        if not self._config.require_sweeps and present(self._annotation_file):
            stamps |= set(annotation_stamps(self._annotation_file).tolist())
        if not stamps:
            found = "none" + self._other_annotations()
            raise DataError(self._folder, "frames", found, f"sweeps or {ANNOTATIONS}")
        return sorted(stamps)[: self._config.frames]

    def _other_annotations(self) -> str:
        """Return the words for annotations that lie there under another name."""
        names = sorted(path.name for path in self._folder.glob("annotations*"))
        return f" (there is {', '.join(names)})" if names else ""

    @cached_property
    def _origin_m(self) -> F64:
        path = self._folder / "calibration" / "egovehicle_SE3_sensor.feather"
        return read_lidar_origin(path) if present(path) else np.array(self._config.lidar_origin_m)

    @cached_property
    def _ground(self) -> GroundHeight | None:
        return read_ground_height(self._folder / "map")

    @cached_property
    def _truth(self) -> TruthTable | None:
        if not present(self._annotation_file):
            return None
        return read_annotations(self._annotation_file, self._poses, self._config)

    @cached_property
    def _detections(self) -> DetectionTable | None:
        if self._config.detections is None:
            return None
        if is_general(self._config.detections) or self.detections_at.is_dir():
            return self._general_detections()
        return read_log_detections(self.detections_at, self.name, self._poses, self._config)

    def _general_detections(self) -> DetectionTable | None:
        poses = self._poses.frames
        stamps = tuple(poses)
        names = tuple((str(stamp),) for stamp in stamps)
        frames = SceneFrames(self.name, names, stamps, tuple(poses.values()))
        table = general_detections(self.detections_at, frames, self._config.detector)
        if table is None:
            return None
        return relabelled(table, self._config.class_map, self.detections_at)
