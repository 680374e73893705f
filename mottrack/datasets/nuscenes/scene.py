"""One nuScenes scene."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from mottrack.core import Frame, Pose, Sweep, Truth, TruthTable
from mottrack.core.arrays import I64
from mottrack.datasets.files import inside
from mottrack.datasets.nuscenes.config import CLASSES, NuScenesConfig
from mottrack.datasets.nuscenes.detections import DetectionFile
from mottrack.datasets.nuscenes.record import SceneRecord
from mottrack.datasets.nuscenes.sweeps import read_sweep
from mottrack.datasets.nuscenes.tables import text_of
from mottrack.datasets.nuscenes.truth import interpolated_truth, key_frame_truth
from mottrack.datasets.rigid import quaternion_pose
from mottrack.datasets.tables import DetectionTable, truth_of


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
        sweep = self._sweeps[index]
        sample = int(self._record.sweep_sample[sweep])
        stamp_ns = self._stamp_ns(index)
        key = sample >= 0
        detections = self._detections if key else None
        return Frame(
            stamp_ns=stamp_ns,
            world_T_ego=self._pose(index),
            detections=None if detections is None else detections.objects(sample, stamp_ns),
            truth=self._truth_at(sample, stamp_ns),
            is_key=key,
            token=self._record.sample_token[sample].decode() if key else "",
        )

    def sweep(self, index: int) -> Sweep:
        """Return the LIDAR_TOP sweep at `index`, in the ego frame.

        Raises:
            DataError: the file is missing or damaged, or its name leads out of the root.

        """
        sweep = self._sweeps[index]
        name = self._record.sweep_file[sweep].decode()
        path = inside(self._config.root, name, follow_links=self._config.follow_links)
        mounting = self._record.ego_T_lidar[sweep]
        return read_sweep(path, self._stamp_ns(index), self._pose(index), mounting)

    @property
    def detections_at(self) -> Path:
        """The file of detections; the root where none was named."""
        return self._config.root if self._detection_file is None else self._detection_file.path

    def _stamp_ns(self, index: int) -> int:
        return int(self._record.sweep_stamp_us[self._sweeps[index]]) * 1000

    def _pose(self, index: int) -> Pose:
        pose = self._record.world_T_ego[self._sweeps[index]]
        return quaternion_pose(pose[:4], pose[4:], self._config.root, f"ego pose of {self._name}")

    def _truth_at(self, sample: int, stamp_ns: int) -> Truth | None:
        table = self._truth
        if table is None:
            return None
        if sample >= 0:
            return truth_of(table, sample, stamp_ns)
        before = int(np.searchsorted(self._key_stamp_ns, stamp_ns)) - 1
        if not self._config.interpolate_truth or not 0 <= before < len(self._key_stamp_ns) - 1:
            return None
        return interpolated_truth(table, before, self._key_stamp_ns, stamp_ns)

    @cached_property
    def _truth(self) -> TruthTable | None:
        return key_frame_truth(self._record)

    @cached_property
    def _detections(self) -> DetectionTable | None:
        if self._detection_file is None:
            return None
        table = self._detection_file.table(text_of(self._record.sample_token))
        if table is None or self._config.detector_velocity:
            return table
        return table.without_velocity()


def chosen_sweeps(sweep_sample: I64, rate_hz: int) -> I64:
    """Return which of the sweeps (20 Hz) are frames: all, every second, or the key frames.

    Every second one is counted back from each key frame, so that every key frame has a sweep two
    turns, 0.1 s, before it. Sweeps after the last key frame serve nothing and are left out.
    """
    keys = np.flatnonzero(sweep_sample >= 0)
    if rate_hz == 2:
        return keys
    every = np.arange(keys[-1] + 1, dtype=np.int64)
    to_next_key = keys[np.searchsorted(keys, every)] - every
    return np.compress(to_next_key % (20 // rate_hz) == 0, every)
