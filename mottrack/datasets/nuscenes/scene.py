"""One nuScenes scene: its sweeps, truth at key frames and, on request, between them."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path, PurePosixPath

import numpy as np

from mottrack.core import Frame, Objects, Pose, Sweep, Truth, TruthTable
from mottrack.core.arrays import I64
from mottrack.core.pose import wrap_angle
from mottrack.core.sweep import seconds_between
from mottrack.datasets.detection_files import general_detections, relabelled
from mottrack.datasets.nuscenes.config import NuScenesConfig
from mottrack.datasets.nuscenes.detections import DetectionFile
from mottrack.datasets.scene_boxes import (
    DetectionTable,
    centred_velocities,
    objects_of,
    truth_of,
)
from mottrack.datasets.scene_frames import SceneFrames
from mottrack.datasets.scenes import checked_index
from mottrack.datasets.vehicle import without_own_body
from mottrack.formats.checks import check_interval, check_points, check_rings, read_float_rows
from mottrack.formats.files import inside
from mottrack.formats.nuscenes_classes import CLASS_OF_CATEGORY, CLASSES
from mottrack.formats.nuscenes_records import SceneRecord
from mottrack.formats.nuscenes_tables import text_of
from mottrack.formats.rigid import quaternion_pose, quaternion_yaws

INTENSITY_MAX = 255.0
"""Intensities are stored as the sensor's eight bits."""
RATE_HZ = 20
"""Revolutions of LIDAR_TOP per second."""


class NuScenesScene:
    """Key frames at 2 Hz and, at a rate of 10 or 20 Hz, the LIDAR_TOP sweeps between them.

    The world is nuScenes' global frame. A key frame's token is its sample token; other frames
    have none, no detections, and truth only where it is to be interpolated.
    """

    classes = CLASSES

    def __init__(
        self,
        name: str,
        record: SceneRecord,
        config: NuScenesConfig,
        detections: DetectionFile | None,
    ) -> None:
        self._name, self._record, self._config = name, record, config
        self._detection_file = detections
        self._sweeps = chosen_sweeps(record.sweep_sample, config.rate_hz)
        self._key_stamp_ns = record.sweep_stamp_us[record.sweep_sample >= 0] * 1000

    @property
    def name(self) -> str:
        """`scene-` and a number."""
        return self._name

    @cached_property
    def has_sweeps(self) -> bool:
        """Whether the files of all frames are there.

        Raises:
            DataError: a file's name leads out of the root.
        """
        root = self._config.root
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
        """Return the LIDAR_TOP sweep at `index`, in the ego frame.

        The file is `.pcd.bin`: float32 x, y, z, intensity, ring in the sensor's own frame,
        motion-compensated to its time stamp. Returns of the vehicle itself are left out.

        Raises:
            DataError: missing, empty or cut file, a value that is not finite or out of range, or
                the file's name leads out of the root.
        """
        sweep = self._sweep_row(index)
        name = self._record.sweep_file[sweep].decode()
        path = inside(self._config.root, name, follow_links=self._config.follow_links)
        values = read_float_rows(path, 5)
        check_points(path, values[:, :3])
        intensity, ring = values[:, 3], values[:, 4]
        check_interval(path, "intensity", intensity, INTENSITY_MAX)
        rings = check_rings(path, ring)
        mount = self._record.ego_T_lidar[sweep]
        ego_T_lidar = quaternion_pose(mount[:4], mount[4:], path, "mounting")
        read = Sweep(
            xyz_m=ego_T_lidar.apply(values[:, :3]).astype(np.float32),
            reflectance=intensity / np.float32(INTENSITY_MAX),
            stamp_ns=self._stamp_ns(sweep),
            world_T_ego=self._pose(sweep),
            origin_m=ego_T_lidar.translation_m,
            ring=rings,
        )
        return without_own_body(read, self._config.vehicle)

    @property
    def detections_at(self) -> Path:
        """The file of detections; the root where none was named."""
        return self._config.root if self._detection_file is None else self._detection_file.path

    def _sweep_row(self, index: int) -> int:
        """Return the row of the record's sweeps that a frame is."""
        return int(self._sweeps[checked_index(index, len(self), self._name)])

    def _stamp_ns(self, sweep: int) -> int:
        return int(self._record.sweep_stamp_us[sweep]) * 1000

    def _pose(self, sweep: int) -> Pose:
        pose = self._record.world_T_ego[sweep]
        return quaternion_pose(pose[:4], pose[4:], self._config.root, f"ego pose of {self._name}")

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
        return key_frame_truth(self._record)

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
        return None if table is None else relabelled(table, {n: n for n in CLASSES}, path)

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
        mount = record.ego_T_lidar[keys[0]]
        ego_T_lidar = quaternion_pose(mount[:4], mount[4:], self._config.root, "mounting")
        poses = tuple(self._pose(int(row)) for row in keys)
        return SceneFrames(self._name, names, stamps, poses, ego_T_lidar)


def chosen_sweeps(sweep_sample: I64, rate_hz: int) -> I64:
    """Return which of the sweeps (20 Hz) are frames: all, every second, or the key frames.

    Every second one is counted back from each key frame, so that every key frame has a sweep two
    revolutions, 0.1 s, before it. Sweeps after the last key frame are of no use and left out.

    Args:
        sweep_sample: (S,) the key frame that each sweep is, -1 between key frames.
        rate_hz: 2, 10 or 20.
    """
    keys = np.flatnonzero(sweep_sample >= 0)
    if rate_hz == 2:
        return keys
    every = np.arange(keys[-1] + 1, dtype=np.int64)
    to_next_key = keys[np.searchsorted(keys, every)] - every
    return np.compress(to_next_key % (RATE_HZ // rate_hz) == 0, every)


def key_frame_truth(record: SceneRecord) -> TruthTable | None:
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
        label=np.array([CLASS_OF_CATEGORY.get(name, name) for name in categories], dtype=np.str_),
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
