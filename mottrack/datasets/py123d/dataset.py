"""Logs of 123D by py123d's own API."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from mottrack.core import ConfigError, DataError, Frame, Pose, Sweep, TruthTable
from mottrack.core.arrays import F64, I64
from mottrack.core.errors import InputError
from mottrack.datasets.fitted_velocity import box_velocities
from mottrack.datasets.py123d.config import CLASSES, Py123dConfig
from mottrack.datasets.py123d.log_safety import require_own_labels
from mottrack.datasets.scene_boxes import truth_of
from mottrack.datasets.scenes import checked_index, chosen_scenes, require_scene
from mottrack.datasets.vehicle import without_own_body
from mottrack.formats.checks import (
    check_interval,
    check_points,
    check_rotations,
    check_sizes,
    check_upright,
    check_world_places,
)
from mottrack.formats.columns import Columns
from mottrack.formats.faults import MissingError
from mottrack.formats.files import existing_folder, inside
from mottrack.formats.rigid import quaternion_pose, quaternion_yaws

SYNC = "sync.arrow"
"""What makes a folder a log."""
BOXES, LIDAR, MERGED = "box_detections_se3.arrow", "lidar", "lidar_merged"
"""py123d's names of files, and of the LiDAR that holds the points of all."""
INTENSITY_MAX = 255.0
"""py123d keeps intensities in eight bits."""
MAX_OFFSET_NS = 1e9
"""No point of a revolution is a second away from its stamp; data sets count from various starts."""
# py123d checks little itself: this is what it raises on damaged files
_FAULTS = (
    pa.ArrowException,
    OSError,
    ValueError,
    LookupError,
    AssertionError,
    AttributeError,
    TypeError,
    RuntimeError,
    OverflowError,
)


class Py123d:
    """The logs of a folder in 123D's Arrow format, whatever data set they come from."""

    Config = Py123dConfig
    name = "py123d"

    def __init__(self, config: Py123dConfig) -> None:
        self._config = config
        existing_folder(config.root, "root")
        if importlib.util.find_spec("py123d") is None:
            raise ConfigError("data set 'py123d' needs its API: pip install 'mottrack[py123d]'")

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen logs, or all.

        Raises:
            ConfigError: a chosen log is not there.
            DataError: there is none, or two splits have one of the same name.
        """
        return chosen_scenes(self._config.scenes, tuple(self._folders))

    def scene(self, name: str) -> Py123dScene:
        """Open one log.

        Raises:
            ConfigError: no log has that name.
            DataError: a file of it is missing or damaged.
        """
        require_scene(name, self.scene_names)
        return Py123dScene(self._folders[name], self._config)

    @cached_property
    def _folders(self) -> dict[str, Path]:
        root, split = self._config.root, self._config.split
        start = root if split is None else inside(root, split, follow_links=True)
        found: dict[str, Path] = {}
        for path in sorted(start.glob(f"**/{SYNC}")):
            folder = path.parent
            if folder.name in found:
                expected = "one (dataset.split=...)"
                raise DataError(
                    folder, "log", f"also in {found[folder.name].parent.name}", expected
                )
            found[folder.name] = folder
        if not found:
            raise MissingError(start, "scenes", "none", f"<split>/<log>/{SYNC}")
        return found


class _Box(NamedTuple):
    """One labelled box: frame, track, label, returns (-1: not counted), pose (7,), size (3,)."""

    frame: int
    track: str
    label: str
    points: int
    pose: F64
    size_m: F64


class Py123dScene:
    """A frame for each iteration of a log; the world is the log's global frame, the ego the IMU's.

    Key frames are those with boxes, all where none has any. The token is the stamp.
    """

    classes = CLASSES

    def __init__(self, folder: Path, config: Py123dConfig) -> None:
        self._folder, self._config = folder, config
        require_own_labels(folder)
        with self._faults(SYNC):
            api = importlib.import_module("py123d.api.scene.arrow.arrow_scene_api")
            self._log: Any = api.ArrowSceneAPI(folder)
            times = self._log.get_all_iteration_timestamps()
        self._stamps = [int(time.time_us) * 1000 for time in times][: config.frames]
        if not self._stamps or (np.diff(self._stamps) <= 0).any():
            found = "none" if not self._stamps else "not ascending"
            raise DataError(folder / SYNC, "times", found, "at least one, each later")
        self._poses = [self._pose(index) for index in range(len(self._stamps))]

    @property
    def name(self) -> str:
        """Name of the log."""
        return self._folder.name

    @cached_property
    def has_sweeps(self) -> bool:
        """Whether the log holds point clouds."""
        return bool(self._lidars)

    def __len__(self) -> int:
        return len(self._stamps)

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`, boxes in the world."""
        stamp_ns = self._stamps[checked_index(index, len(self), self.name)]
        labelled = index in self._labelled_frames
        return Frame(
            stamp_ns=stamp_ns,
            world_T_ego=self._poses[index],
            truth=truth_of(self._truth, index, stamp_ns) if labelled else None,
            is_key=labelled or not self._labelled_frames,
            token=str(stamp_ns),
        )

    def sweep(self, index: int) -> Sweep:
        """Return the points at `index`, of all LiDARs, in the ego frame.

        Raises:
            DataError: a file is missing or damaged, or a value is not finite.
            InputError: the log holds no point clouds.
        """
        stamp_ns = self._stamps[checked_index(index, len(self), self.name)]
        if not self._lidars:
            raise InputError("sweep", index, f"a log with point clouds; {self._folder} has none")
        parts = []
        for name in self._lidars:
            with self._faults(f"{LIDAR}.{name}.arrow"):
                part = self._log.get_lidar_at_iteration(index, name)
                parts += [] if part is None else [part]
        if not parts:
            raise MissingError(self._folder, f"lidar at {stamp_ns}", "missing", "a point cloud")
        xyz_m = np.concatenate([np.asarray(part.xyz, dtype=np.float64) for part in parts])
        check_points(self._folder, xyz_m)
        first = next(iter(parts[0].lidar_metadatas.values()))
        read = Sweep(
            xyz_m=xyz_m.astype(np.float32),
            reflectance=self._reflectance(parts),
            stamp_ns=stamp_ns,
            world_T_ego=self._poses[index],
            origin_m=np.asarray(first.lidar_to_imu_se3.array[:3], dtype=np.float64),
            time_offset_ns=_offsets_ns(parts, stamp_ns),
            ring=_rings(parts),
        )
        return without_own_body(read, self._config.vehicle)

    def _reflectance(self, parts: list[Any]) -> np.ndarray[tuple[int], np.dtype[np.float32]]:
        columns = [
            np.zeros(len(part.xyz)) if part.intensity is None else part.intensity for part in parts
        ]
        intensity = np.concatenate(columns).astype(np.float32)
        check_interval(self._folder, "intensity", intensity, INTENSITY_MAX)
        return (intensity / np.float32(INTENSITY_MAX)).astype(np.float32)

    @cached_property
    def _lidars(self) -> tuple[str, ...]:
        """The LiDARs to read, by name: the merged one where the log has it."""
        names = sorted(path.stem for path in self._folder.glob(f"{LIDAR}.*.arrow"))
        names = [name.removeprefix(f"{LIDAR}.") for name in names]
        return (MERGED,) if MERGED in names else tuple(names)

    def _pose(self, index: int) -> Pose:
        with self._faults("ego_state_se3.arrow"):
            state = self._log.get_ego_state_se3_at_iteration(index)
        field = f"ego state at {self._stamps[index]}"
        if state is None:
            raise MissingError(self._folder, field, "missing", "one at each iteration")
        values = np.asarray(state.imu_se3.array, dtype=np.float64)
        return quaternion_pose(values[3:], values[:3], self._folder, field)

    @cached_property
    def _boxes(self) -> tuple[list[_Box], frozenset[int]]:
        """All boxes of the log, and the frames that have labels, with boxes or without."""
        boxes: list[_Box] = []
        seen = set()
        for index in range(len(self)):
            with self._faults(BOXES):
                found = self._log.get_box_detections_se3_at_iteration(index)
                if found is not None:
                    seen.add(index)
                    boxes += [_box(index, one, self._config.class_map) for one in found]
        return boxes, frozenset(seen)

    @property
    def _labelled_frames(self) -> frozenset[int]:
        return self._boxes[1]

    @cached_property
    def _truth(self) -> TruthTable | None:
        boxes, seen = self._boxes
        if not seen:
            return None
        table = self._checked(boxes)
        identity = np.unique(table["track"], return_inverse=True)[1].astype(np.int64)
        keys = np.column_stack([table["frame"], identity])
        table.refuse_repeated("track", keys, "each track once a frame")
        stamps = np.array(self._stamps, dtype=np.int64)[table["frame"]]
        return TruthTable(
            frame=table["frame"],
            id=identity,
            label=table["label"],
            centre_m=table["translation"],
            size_m=table["size"],
            yaw_rad=quaternion_yaws(table["rotation"]),
            velocity_mps=box_velocities(
                identity, stamps, table["translation"], fitted=self._config.fitted_velocity
            ),
            num_points=table["points"],
            interpolated=np.zeros(len(table), dtype=bool),
        )

    def _checked(self, boxes: list[_Box]) -> Columns:
        poses = np.array([box.pose for box in boxes]).reshape(-1, 7)
        frame = np.array([box.frame for box in boxes], dtype=np.int64)
        table = Columns(
            self._folder / BOXES,
            {
                "frame": frame,
                "track": np.array([box.track for box in boxes], dtype=np.str_),
                "label": np.array([box.label for box in boxes], dtype=np.str_),
                "points": np.array([box.points for box in boxes], dtype=np.int64),
                "translation": poses[:, :3],
                "rotation": poses[:, 3:],
                "size": np.array([box.size_m for box in boxes]).reshape(-1, 3),
            },
            frame,
            lambda name, index: f"{name} of a box at {self._stamps[index]}",
        )
        for name in ("translation", "rotation", "size"):
            table.refuse(name, ~np.isfinite(table[name]), "finite numbers")
        check_sizes(table, "size")
        check_rotations(table)
        check_upright(table)
        check_world_places(table)
        return table

    @contextmanager
    def _faults(self, file: str) -> Iterator[None]:
        try:
            yield
        except DataError:
            raise
        except _FAULTS as error:
            reason = f"{type(error).__name__}: {error}".splitlines()[0]
            path = self._folder / file
            raise DataError(path, "content", f"unreadable ({reason})", "a 123D log") from error


def _box(frame: int, one: Any, class_map: dict[str, str]) -> _Box:
    attributes, box = one.attributes, one.bounding_box_se3
    name = attributes.label.name
    count = attributes.num_lidar_points
    return _Box(
        frame,
        str(attributes.track_token),
        class_map.get(name, name.lower()),
        -1 if count is None else int(count),
        np.asarray(one.center_se3.array, dtype=np.float64),
        np.array([box.length, box.width, box.height], dtype=np.float64),
    )


def _offsets_ns(parts: list[Any], stamp_ns: int) -> I64 | None:
    """Return when each point was measured (N,); None where a part does not say."""
    times = [part.timestamps for part in parts if part.timestamps is not None]
    if len(times) < len(parts):
        return None
    offsets: I64 = np.concatenate(times).astype(np.int64) * 1000 - stamp_ns
    return offsets if np.abs(offsets).max(initial=0) <= MAX_OFFSET_NS else None


def _rings(parts: list[Any]) -> np.ndarray[tuple[int], np.dtype[np.int16]] | None:
    """Return the beam of each point; None of several LiDARs, which number theirs alike."""
    if len(parts) > 1 or parts[0].channel is None:
        return None
    return np.asarray(parts[0].channel, dtype=np.int16)
