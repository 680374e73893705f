"""A KITTI tracking data set, read as it was downloaded."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from mottrack.core import DataError, Frame, Pose, Sweep, TruthTable
from mottrack.core.concerns import Concern
from mottrack.core.sweep import SECOND_NS
from mottrack.datasets.detection_files import (
    SCENE,
    general_detections,
    is_general,
    relabelled,
)
from mottrack.datasets.fitted_velocity import box_velocities
from mottrack.datasets.kitti.boxes import camera_to_ego
from mottrack.datasets.kitti.camera import Camera
from mottrack.datasets.kitti.config import CLASSES, KittiConfig
from mottrack.datasets.kitti.labels import (
    camera_boxes,
    read_detection_file,
    read_label_file,
    read_object_folder,
)
from mottrack.datasets.kitti.layout import SequenceFiles
from mottrack.datasets.kitti.poses import read_calibration, read_camera_poses, read_oxts
from mottrack.datasets.scene_boxes import (
    DetectionTable,
    objects_of,
    to_world,
    truth_of,
    unknown_velocities,
)
from mottrack.datasets.scene_frames import SceneFrames
from mottrack.datasets.scenes import (
    SWEEP_OR_OPTION,
    checked_index,
    chosen_scenes,
    require_scene,
    scenes_in,
)
from mottrack.datasets.vehicle import without_own_body
from mottrack.formats.checks import check_interval, check_points, read_float_rows
from mottrack.formats.columns import Columns
from mottrack.formats.faults import MissingError
from mottrack.formats.files import existing_folder, present


class Kitti:
    """The 21 training or 29 test sequences of KITTI tracking, or those that are there.

    The ego frame is the Velodyne's. The world starts at the first frame, z-up; see
    `mottrack.datasets.kitti.poses`. Only objects in the camera's view are labelled: every frame
    says so in `labelled_azimuth_rad`.
    """

    Config = KittiConfig
    name = "kitti"

    def __init__(self, config: KittiConfig) -> None:
        self._config = config
        self._folder = existing_folder(config.root / config.split, "split")

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen sequences, or all that have a calibration."""
        calibrations = existing_folder(self._folder / "calib", "calib")
        return chosen_scenes(self._config.scenes, scenes_in(calibrations, "*.txt"))

    def scene(self, name: str) -> KittiScene:
        """Open one sequence.

        Raises:
            ConfigError: no sequence has that name.
            DataError: a file of it is missing or damaged.
        """
        require_scene(name, self.scene_names)
        return KittiScene(SequenceFiles(self._config, name))


class KittiScene:
    """Frames of one sequence at 10 Hz, each a key frame; its token is KITTI's frame number.

    Stamps are frame number times the configured period, since KITTI tracking records none.
    """

    classes = CLASSES

    def __init__(self, files: SequenceFiles) -> None:
        self._files = files
        self._calibration = read_calibration(files.text("calib"))
        self._poses = self._read_poses()
        self._numbers = self._chosen_frames()

    @property
    def name(self) -> str:
        """KITTI's sequence number, four digits."""
        return self._files.sequence

    @cached_property
    def has_sweeps(self) -> bool:
        """Whether every frame of the scene has a sweep."""
        recorded = set(self._files.recorded_frames(len(self._poses)))
        return recorded.issuperset(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`, boxes in the world."""
        number = self._number(index)
        stamp_ns = self._stamp_ns(number)
        return Frame(
            stamp_ns=stamp_ns,
            world_T_ego=self._poses[number],
            detections=objects_of(self._detections, number, stamp_ns),
            truth=truth_of(self._truth, number, stamp_ns),
            token=f"{number:06d}",
            labelled_azimuth_rad=self._calibration.field_of_view_rad,
        )

    def sweep(self, index: int) -> Sweep:
        """Return the sweep at `index`: float32 x, y, z in the ego frame, reflectance.

        Raises:
            DataError: missing, empty or cut file, a value that is not finite or out of range.
        """
        number = self._number(index)
        path = self._files.sweep(number)
        if not present(path):
            raise MissingError(path, "sweep", "missing", SWEEP_OR_OPTION)
        values = read_float_rows(path, 4)
        check_points(path, values[:, :3])
        check_interval(path, "reflectance", values[:, 3], 1.0)
        stamp_ns, pose = self._stamp_ns(number), self._poses[number]
        read = Sweep(values[:, :3], values[:, 3], stamp_ns, pose)
        return without_own_body(read, self._files.config.vehicle)

    @property
    def detections_at(self) -> Path:
        """Pattern of the detector's files; the root where none were named."""
        return self._files.detections_at

    @property
    def concerns(self) -> tuple[Concern, ...]:
        """Poses beyond the last frame that has labels or a sweep: another sequence's, perhaps."""
        swept = self._files.last_frame() + 1
        known = max(self._frames_labelled(), swept)
        beyond = len(self._poses) - known
        if beyond <= 0 or not swept:  # the last frames of a sequence may be without any label
            return ()
        text = f"after frame {known - 1}, the last with labels or a sweep"
        return (Concern("poses of no frame", beyond, text),)

    def _number(self, index: int) -> int:
        return self._numbers[checked_index(index, len(self), self.name)]

    def _stamp_ns(self, number: int) -> int:
        return round(number * self._files.config.period_s * SECOND_NS)

    def _read_poses(self) -> list[Pose]:
        files, source = self._files, self._files.config.poses
        if source == "none":
            return [Pose.identity()] * max(self._frames_labelled(), files.last_frame() + 1)
        if source == "poses" or (source == "auto" and not present(files.text("oxts"))):
            path, read = files.text("poses"), read_camera_poses
        else:
            path, read = files.text("oxts"), read_oxts
        poses = read(path, self._calibration)
        if len(poses) < self._frames_labelled():
            expected = f"{self._frames_labelled()}, one for each labelled frame"
            raise MissingError(path, "number of poses", len(poses), expected)
        return poses

    def _frames_labelled(self) -> int:
        return 0 if self._labels is None else int(self._labels["frame"].max(initial=-1)) + 1

    def _chosen_frames(self) -> list[int]:
        numbers = list(range(len(self._poses)))
        if self._files.config.require_sweeps:
            numbers = self._files.recorded_frames(len(numbers))
        if not numbers:
            raise MissingError(self._files.sweeps, "sweeps", "missing", "at least one <frame>.bin")
        return numbers[: self._files.config.frames]

    @cached_property
    def _labels(self) -> Columns | None:
        path = self._files.text("label_02")
        return read_label_file(path) if present(path) else None

    @cached_property
    def _truth(self) -> TruthTable | None:
        if self._labels is None:
            return None
        rows = self._in_world(self._labels)
        frame, track = rows["frame"], rows["track"]
        stamps = np.array([self._stamp_ns(number) for number in frame], dtype=np.int64)
        fitted = self._files.config.fitted_velocity
        table = TruthTable(
            frame=frame,
            id=track,
            label=rows["label"],
            centre_m=rows["centre_m"],
            size_m=rows["size_m"],
            yaw_rad=rows["yaw_rad"],
            velocity_mps=box_velocities(track, stamps, rows["centre_m"], fitted=fitted),
            num_points=np.full(len(rows), -1),
            interpolated=np.zeros(len(rows), dtype=bool),
        )
        kept = table.select(table.label != "")
        return kept.select(np.argsort(kept.frame, kind="stable"))

    @cached_property
    def _detections(self) -> DetectionTable | None:
        if is_general(self._files.config.detections):
            return self._general_detections()
        tables = [self._detection_table(path) for path in self._files.detections]
        return DetectionTable.stacked(tables) if tables else None

    def _general_detections(self) -> DetectionTable | None:
        files = self._files
        folder = Path(str(files.detections_at).replace(SCENE, self.name))
        if folder.is_dir() and any(folder.glob("*.txt")):
            return self._detection_table(folder)
        table = general_detections(files.detections_at, self.all_frames(), files.config.detector)
        return None if table is None else relabelled(table, files.config.class_map, folder)

    @property
    def camera(self) -> Camera:
        """Where the camera is, in whose frame KITTI's files have boxes."""
        return Camera(self._calibration.ego_T_camera, self._calibration.projection)

    @property
    def class_map(self) -> dict[str, str]:
        """KITTI type to label."""
        return self._files.config.class_map

    def all_frames(self) -> SceneFrames:
        """Return the frames of the sequence as files of boxes know them: by their number."""
        numbers = range(len(self._poses))
        stamps = tuple(self._stamp_ns(number) for number in numbers)
        names = tuple((f"{n:06d}", str(n), str(stamp)) for n, stamp in enumerate(stamps))
        return SceneFrames(self.name, names, stamps, tuple(self._poses))

    def _detection_table(self, path: Path) -> DetectionTable:
        """Return the detections of a file of AB3DMOT's, or of a folder of the object benchmark."""
        detected = read_object_folder(path) if path.is_dir() else read_detection_file(path)
        if detected["frame"].max(initial=-1) >= len(self._poses):
            expected = f"below {len(self._poses)}, the number of poses"
            raise DataError(path, "frame", int(detected["frame"].max()), expected)
        rows = self._in_world(detected)
        table = DetectionTable(
            frame=rows["frame"],
            label=rows["label"],
            score=rows["score"],
            centre_m=rows["centre_m"],
            size_m=rows["size_m"],
            yaw_rad=rows["yaw_rad"],
            velocity_mps=unknown_velocities(len(rows)),
        )
        return table.select(table.label != "")

    def _in_world(self, rows: Columns) -> Columns:
        """Return the rows with their label, "" for a type that has none, and boxes in the world."""
        class_map = self._files.config.class_map
        label = np.array([class_map.get(str(kind), "") for kind in rows["type"]], dtype=np.str_)
        ego = camera_to_ego(camera_boxes(rows), self._calibration.ego_T_camera)
        centre_m, yaw_rad = to_world(ego.centre_m, ego.yaw_rad, rows["frame"], self._poses)
        return rows.extended(label=label, centre_m=centre_m, size_m=ego.size_m, yaw_rad=yaw_rad)
