"""One nuScenes scene: its sweeps, truth at key frames and, on request, between them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from mottrack.core import Frame, Objects, Pose, Sweep, Truth, TruthTable
from mottrack.core.arrays import F64, I64
from mottrack.core.label_velocities import centred_velocities
from mottrack.core.pose import wrap_angle
from mottrack.core.sweep import seconds_between
from mottrack.datasets.detection_files import general_detections, relabelled
from mottrack.datasets.nuscenes.config import RatedConfig
from mottrack.datasets.nuscenes.detections import DetectionFile
from mottrack.datasets.nuscenes.dialect import Dialect
from mottrack.datasets.scene_boxes import (
    DetectionTable,
    objects_of,
    truth_of,
)
from mottrack.datasets.scene_frames import SceneFrames
from mottrack.datasets.scenes import checked_index
from mottrack.datasets.vehicle import without_own_body
from mottrack.formats.files import inside
from mottrack.formats.nuscenes_records import SceneRecord
from mottrack.formats.nuscenes_tables import text_of
from mottrack.formats.rigid import quaternion_pose, quaternion_yaws

MAX_APART_US = 50_000
"""Half the period of a LiDAR of 10 Hz: a sweep farther from the main one's is of another
revolution."""


class Source(NamedTuple):
    """Where a scene comes from: the folder that file names start at, settings, dialect."""

    root: Path
    config: RatedConfig
    dialect: Dialect


class NuScenesScene:
    """Key frames at 2 Hz and, at a rate of 10 or 20 Hz, the LiDAR's sweeps between them.

    The world is the tables' global frame. A key frame's token is its sample token; other frames
    have none, no detections, and truth only where it is to be interpolated.
    """

    def __init__(
        self,
        name: str,
        record: SceneRecord,
        source: Source,
        detections: DetectionFile | None,
    ) -> None:
        self._name, self._record, self._detection_file = name, record, detections
        self._root, self._config, self._dialect = source
        sensor_hz = self._dialect.sensor_hz
        self._sweeps = chosen_sweeps(record.sweep_sample, self._config.rate_hz, sensor_hz)
        self._key_stamp_ns = record.sweep_stamp_us[record.sweep_sample >= 0] * 1000

    @property
    def name(self) -> str:
        """`scene-` and a number, or, of T4, the data set's own name."""
        return self._name

    @property
    def classes(self) -> tuple[str, ...]:
        """The labels that are scored."""
        return self._dialect.classes

    @cached_property
    def has_sweeps(self) -> bool:
        """Whether the files of all frames are there.

        Raises:
            DataError: a file's name leads out of the root.
        """
        root = self._root
        files = text_of(self._record.sweep_file[self._sweeps])
        return all(inside(root, file, follow_links=True).is_file() for file in files)

    def __len__(self) -> int:
        return len(self._sweeps)

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`."""
        sweep = self._sweep_row(index)
        sample = int(self._record.sweep_sample[sweep])
        stamp_ns = self._stamp_ns(sweep)
        key = sample >= 0
        return Frame(
            stamp_ns=stamp_ns,
            world_T_ego=self._pose(sweep),
            detections=self._detections_at(sample, stamp_ns) if key else None,
            truth=self._truth_at(sample, stamp_ns),
            is_key=key,
            token=self._record.sample_token[sample].decode() if key else "",
        )

    def sweep(self, index: int) -> Sweep:
        """Return the sweep at `index`, in the ego frame.

        The points are in the sensor's own frame, motion-compensated to its time stamp. Sweeps of
        further LiDARs, each at its own time and ego pose, are joined in the ego frame of the main
        one. Returns of the vehicle itself are left out.

        Raises:
            DataError: missing, empty or cut file, a value that is not finite or out of range, or
                the file's name leads out of the root.
        """
        sweep = self._sweep_row(index)
        path = self._path(self._record.sweep_file[sweep])
        mounting = _pose_of(self._record.ego_T_lidar[sweep], path, "mounting")
        stamp_ns, world_T_ego = self._stamp_ns(sweep), self._pose(sweep)
        main = self._dialect.read_points(path)
        parts = [(main, mounting.apply(main.xyz_m))]
        for row in self._parts_at(int(self._record.sweep_stamp_us[sweep])):
            part = self._dialect.read_points(self._path(self._record.part_file[row]))
            ego_T_part = world_T_ego.inverse() @ self._world_T_part(row)
            parts.append((part, ego_T_part.apply(part.xyz_m)))
        times = [part.stamp_us for part, _ in parts if part.stamp_us is not None]
        timed = len(times) == len(parts)
        read = Sweep(
            xyz_m=np.concatenate([xyz_m for _, xyz_m in parts]).astype(np.float32),
            reflectance=np.concatenate([part.reflectance for part, _ in parts]),
            stamp_ns=stamp_ns,
            world_T_ego=world_T_ego,
            origin_m=mounting.translation_m,
            time_offset_ns=np.concatenate(times) * 1000 - stamp_ns if timed else None,
            # several sensors number their beams alike
            ring=main.ring if len(parts) == 1 else None,
        )
        return without_own_body(read, self._config.vehicle)

    def _parts_at(self, stamp_us: int) -> list[int]:
        """Return the row of each further LiDAR's sweep next to a time, if it has one near."""
        record = self._record
        rows = []
        for channel in np.unique(record.part_channel):
            own = np.flatnonzero(record.part_channel == channel)
            apart = np.abs(record.part_stamp_us[own] - stamp_us)
            if apart.min() <= MAX_APART_US:
                rows.append(int(own[apart.argmin()]))
        return rows

    def _world_T_part(self, row: int) -> Pose:
        record, path = self._record, self._root
        world_T_ego = _pose_of(record.part_world_T_ego[row], path, f"ego pose of {self._name}")
        return world_T_ego @ _pose_of(record.part_ego_T_lidar[row], path, "mounting")

    def _path(self, name: bytes) -> Path:
        return inside(self._root, name.decode(), follow_links=self._config.follow_links)

    @property
    def detections_at(self) -> Path:
        """The file of detections; the root where none was named."""
        return self._root if self._detection_file is None else self._detection_file.path

    def _sweep_row(self, index: int) -> int:
        """Return the row of the record's sweeps that a frame is."""
        return int(self._sweeps[checked_index(index, len(self), self._name)])

    def _stamp_ns(self, sweep: int) -> int:
        return int(self._record.sweep_stamp_us[sweep]) * 1000

    def _pose(self, sweep: int) -> Pose:
        pose = self._record.world_T_ego[sweep]
        return _pose_of(pose, self._root, f"ego pose of {self._name}")

    def _truth_at(self, sample: int, stamp_ns: int) -> Truth | None:
        table = self._truth
        if table is None or sample >= 0:
            return truth_of(table, sample, stamp_ns)
        before = int(np.searchsorted(self._key_stamp_ns, stamp_ns)) - 1
        if not self._config.interpolate_truth or not 0 <= before < len(self._key_stamp_ns) - 1:
            return None
        return interpolated_truth(table, before, self._key_stamp_ns, stamp_ns)

    @cached_property
    def _truth(self) -> TruthTable | None:
        return key_frame_truth(self._record, self._dialect.class_of_category)

    def _detections_at(self, sample: int, stamp_ns: int) -> Objects | None:
        velocities = self._config.detector_velocity
        return objects_of(self._detections, sample, stamp_ns, velocities=velocities)

    @cached_property
    def _detections(self) -> DetectionTable | None:
        if self._detection_file is None:
            return None
        if not self._detection_file.official:
            return self._general_detections(self._detection_file.path)
        return self._detection_file.table(text_of(self._record.sample_token))

    def _general_detections(self, path: Path) -> DetectionTable | None:
        table = general_detections(path, self._samples(), self._config.detector)
        return None if table is None else relabelled(table, {n: n for n in self.classes}, path)

    def _samples(self) -> SceneFrames:
        """Return the key frames as files of boxes know them: by token, stamp or sweep."""
        record = self._record
        keys = np.flatnonzero(record.sweep_sample >= 0)
        stamps = tuple(self._stamp_ns(int(row)) for row in keys)
        sweeps = [PurePosixPath(name).name for name in text_of(record.sweep_file[keys])]
        stems = [name.removesuffix(".bin").removesuffix(".pcd") for name in sweeps]
        tokens = text_of(record.sample_token[record.sweep_sample[keys]])
        names = tuple(
            (token, str(stamp), stem, f"{stem}.pcd")
            for token, stamp, stem in zip(tokens, stamps, stems, strict=True)
        )
        ego_T_lidar = _pose_of(record.ego_T_lidar[keys[0]], self._root, "mounting")
        poses = tuple(self._pose(int(row)) for row in keys)
        return SceneFrames(self._name, names, stamps, poses, ego_T_lidar)


def _pose_of(values: F64, path: Path, field: str) -> Pose:
    """Return the pose of a quaternion and a place (7,)."""
    return quaternion_pose(values[:4], values[4:], path, field)


def chosen_sweeps(sweep_sample: I64, rate_hz: int, sensor_hz: int = 20) -> I64:
    """Return which of the sweeps are frames: all, every second, or the key frames.

    Every second one is counted back from each key frame, so that every key frame has a sweep two
    revolutions, 0.1 s, before it. Sweeps after the last key frame are of no use and left out.

    Args:
        sweep_sample: (S,) the key frame that each sweep is, -1 between key frames.
        rate_hz: 2 for the key frames alone, else at most that of the sensor.
        sensor_hz: revolutions a second.
    """
    keys = np.flatnonzero(sweep_sample >= 0)
    if rate_hz == 2:
        return keys
    every = np.arange(keys[-1] + 1, dtype=np.int64)
    to_next_key = keys[np.searchsorted(keys, every)] - every
    return np.compress(to_next_key % (sensor_hz // rate_hz) == 0, every)


def key_frame_truth(record: SceneRecord, class_of_category: Mapping[str, str]) -> TruthTable | None:
    """Return the annotations, `frame` counting key frames; None without annotations.

    Velocities follow nuScenes' own rule: the difference of the neighbouring annotations'
    positions, centred where both exist, unknown over more than 1.5 s (3 s centred). Categories
    that are not tracked keep their own name: they are not scored, but some of them move, and what
    stands in a bicycle rack is not evaluated.
    """
    if not record.annotated[0]:
        return None
    key_stamp_us = record.sweep_stamp_us[record.sweep_sample >= 0]
    stamp_ns = key_stamp_us[record.box_sample] * 1000
    categories = text_of(record.box_category)
    return TruthTable(
        frame=record.box_sample,
        id=record.box_instance,
        label=np.array([class_of_category.get(name, name) for name in categories], dtype=np.str_),
        centre_m=record.box_centre_m,
        size_m=record.box_size_wlh_m[:, [1, 0, 2]],
        yaw_rad=wrap_angle(quaternion_yaws(record.box_rotation)),
        velocity_mps=centred_velocities(record.box_instance, stamp_ns, record.box_centre_m),
        num_points=record.box_points,
        interpolated=np.zeros(len(stamp_ns), dtype=bool),
    )


def interpolated_truth(
    table: TruthTable, key_frame: int, key_stamp_ns: I64, stamp_ns: int
) -> Truth:
    """Return the truth between two key frames, of the objects annotated in both.

    Args:
        table: truth at key frames.
        key_frame: the last key frame before `stamp_ns`; there is one after it.
        key_stamp_ns: (K,) times of the key frames.
        stamp_ns: the time wanted.
    """
    before, after = (table.select(table.frame == key) for key in (key_frame, key_frame + 1))
    _, left, right = np.intersect1d(before.id, after.id, return_indices=True)
    before, after = before.select(left), after.select(right)
    before_ns, after_ns = int(key_stamp_ns[key_frame]), int(key_stamp_ns[key_frame + 1])
    share = (stamp_ns - before_ns) / (after_ns - before_ns)
    moved = after.centre_m - before.centre_m
    turned = wrap_angle(after.yaw_rad - before.yaw_rad)
    return Truth(
        stamp_ns=stamp_ns,
        frame="world",
        centre_m=before.centre_m + share * moved,
        size_m=before.size_m,
        yaw_rad=wrap_angle(before.yaw_rad + share * turned),
        label=before.label,
        id=before.id,
        velocity_mps=moved[:, :2] / seconds_between(before_ns, after_ns),
        num_points=np.full(len(left), -1),
        interpolated=np.ones(len(left), dtype=bool),
    )
