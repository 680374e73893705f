"""The point clouds of a log as sweeps: several topics merged, points moved to one time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core import Sweep
from mottrack.core.arrays import F64, I64
from mottrack.core.concerns import Concern
from mottrack.core.errors import DataError, InputError
from mottrack.core.sweep import SECOND_NS
from mottrack.datasets.ros.config import RosConfig
from mottrack.datasets.ros.log import Log, MessageTime
from mottrack.datasets.ros.message_types import POINT_TYPES
from mottrack.datasets.ros.messages import (
    RING_FIELDS,
    TIME_FIELDS,
    point_columns,
    time_offsets_ns,
    xyz_of,
)
from mottrack.datasets.ros.motion import Motion
from mottrack.datasets.ros.transforms import frame_name
from mottrack.formats.checks import check_points, check_rings
from mottrack.formats.faults import MissingError, OutOfOrderError


@dataclass(frozen=True)
class Part:
    """The points of one message, in the ego frame of the sweep's stamp."""

    xyz_m: F64
    reflectance: NDArray[np.float32]
    origin_m: F64
    offset_ns: I64 | None
    ring: NDArray[np.int16] | None


class Clouds:
    """The point clouds of a log: one a frame, or one of each topic, merged."""

    def __init__(self, log: Log, config: RosConfig, motion: Motion, topics: Sequence[str]) -> None:
        self._log, self._config, self._motion, self._topics = log, config, motion, topics
        by_topic = [self._times_of(topic) for topic in topics]
        kept = _within(by_topic, motion)
        if not kept:
            raise MissingError(log.path, "frames", "none", _spans(by_topic, motion))
        self.left_out = len(by_topic[0]) - len(kept)
        self._times = [_matched(by_topic, time, config.match_s) for time in kept]
        self._lost = sum(time is None for times in self._times for time in times)

    @property
    def stamps_ns(self) -> list[int]:
        """The time of each frame, that of the first topic's cloud."""
        return [times[0].stamp_ns for times in self._times if times[0] is not None]

    def concerns(self) -> list[Concern]:
        """Return what was left out or assumed."""
        found = []
        if self.left_out:
            text = "before or after the vehicle's poses or another topic's clouds"
            found.append(Concern("clouds at the ends of the log left out", self.left_out, text))
        if self._lost:
            text = f"no cloud within {self._config.match_s:g} s of the first topic's"
            found.append(Concern("clouds missing between others", self._lost, text))
        for number, topic in enumerate(self._topics):
            index = next(i for i, times in enumerate(self._times) if times[number] is not None)
            frame = frame_name(self._message(index, number).header.frame_id)
            if self._motion.mounting is None and not self._motion.knows(frame):
                text = (
                    f"{frame} of {topic}: taken for {self._motion.ego} "
                    "(dataset.lidar_position_m, lidar_yaw_rad)"
                )
                found.append(Concern("points in a frame that tf does not place", 1, text))
        return found

    def sweep(self, index: int) -> Sweep:
        """Return the points of a frame in the ego frame.

        Raises:
            DataError: a message is damaged.
        """
        stamp_ns = self.stamps_ns[index]
        numbers = [n for n, time in enumerate(self._times[index]) if time is not None]
        parts = [self._part(self._message(index, n), stamp_ns) for n in numbers]
        offsets = [part.offset_ns for part in parts]
        return Sweep(
            xyz_m=np.concatenate([part.xyz_m for part in parts]).astype(np.float32),
            reflectance=np.concatenate([part.reflectance for part in parts]),
            stamp_ns=stamp_ns,
            world_T_ego=self._motion.trajectory.at(stamp_ns),
            origin_m=parts[0].origin_m,
            time_offset_ns=_joined(offsets),
            # the beams of several sensors have the same numbers
            ring=parts[0].ring if len(self._topics) == 1 else None,
        )

    def _part(self, message: Any, stamp_ns: int) -> Part:
        """Return the points of a message, moved to the time of the sweep."""
        path, config = self._log.path, self._config
        columns = point_columns(message, path)
        xyz_m = xyz_of(columns)
        own_ns = _stamp(message)
        mounting = self._motion.ego_T_points(frame_name(message.header.frame_id), own_ns)
        if not len(xyz_m):  # a LiDAR that saw nothing, or whose packets were lost
            none, no_offsets = np.zeros(0, np.float32), np.zeros(0, np.int64)
            return Part(xyz_m, none, mounting.translation_m, no_offsets, None)
        check_points(path, xyz_m)
        intensity = columns.get("intensity", np.zeros(len(xyz_m))).astype(np.float32)
        ring = next((columns[name] for name in RING_FIELDS if name in columns), None)
        own_offset_ns = time_offsets_ns(columns, own_ns)
        xyz_m = self._at_stamp(mounting.apply(xyz_m), own_offset_ns, own_ns, stamp_ns)
        return Part(
            xyz_m,
            np.clip(np.nan_to_num(intensity) / np.float32(config.intensity_max), 0.0, 1.0),
            mounting.translation_m,
            None if own_offset_ns is None else own_offset_ns + (own_ns - stamp_ns),
            None if ring is None else check_rings(path, ring),
        )

    def _at_stamp(self, xyz_m: F64, offset_ns: I64 | None, own_ns: int, stamp_ns: int) -> F64:
        """Return points (N, 3), in the ego frame of their own times, in that of the sweep."""
        if self._config.motion_compensation:
            if offset_ns is None:
                expected = f"one of {', '.join(TIME_FIELDS)}, within a second of the stamp"
                raise DataError(self._log.path, "time of each point", "unknown", expected)
            return self._motion.trajectory.moved(xyz_m, own_ns + offset_ns, stamp_ns)
        if own_ns == stamp_ns:
            return xyz_m
        times = np.full(len(xyz_m), own_ns, dtype=np.int64)
        return self._motion.trajectory.moved(xyz_m, times, stamp_ns)

    def _message(self, index: int, number: int) -> Any:
        time = self._times[index][number]
        if time is None:
            raise InputError("topic", self._topics[number], f"one with a cloud at frame {index}")
        return self._log.message(self._topics[number], time)

    def _times_of(self, topic: str) -> list[MessageTime]:
        times = sorted(self._log.times(topic, POINT_TYPES), key=lambda time: time.stamp_ns)
        stamps = [time.stamp_ns for time in times]
        if len(set(stamps)) != len(stamps):
            raise OutOfOrderError(self._log.path, topic, "a stamp twice", "each stamp once")
        return times


def cloud_topics(log: Log, config: RosConfig) -> tuple[str, ...]:
    """Return the topics of points: as configured, else the only one; () where there is none.

    Raises:
        DataError: there are several, and none was chosen.
    """
    if config.points_topic is not None:
        named = config.points_topic
        return (named,) if isinstance(named, str) else named
    topics = log.of_kind(POINT_TYPES)
    if len(topics) > 1:
        found = f"one of several: {', '.join(topics)}"
        raise DataError(log.path, "points", found, "dataset.points_topic=<one>, or a list of them")
    if not topics and config.detections_topic is None:
        others = "one of " + (", ".join(sorted(log.topics)) or "no topic at all")
        raise DataError(log.path, "topic", f"none of {POINT_TYPES[0]}", others)
    return topics


def _within(by_topic: Sequence[Sequence[MessageTime]], motion: Motion) -> list[MessageTime]:
    """Return the first topic's clouds of the time in which there are poses and all topics.

    Recorders start and end topics at different times. Half a cloud would be a sudden change.
    """
    path = motion.trajectory
    first, last = path.first_ns, path.last_ns
    for times in by_topic[1:]:
        half_ns = _period_ns(times) // 2
        first, last = (
            max(first, times[0].stamp_ns - half_ns),
            min(last, times[-1].stamp_ns + half_ns),
        )
    return [time for time in by_topic[0] if first <= time.stamp_ns <= last]


def _period_ns(times: Sequence[MessageTime]) -> int:
    return int(np.median(np.diff([time.stamp_ns for time in times]))) if len(times) > 1 else 0


def _spans(by_topic: Sequence[Sequence[MessageTime]], motion: Motion) -> str:
    ends = [(times[0].stamp_ns, times[-1].stamp_ns) for times in by_topic]
    ends.append((motion.trajectory.first_ns, motion.trajectory.last_ns))
    words = [f"{first / SECOND_NS:.3f} to {last / SECOND_NS:.3f}" for first, last in ends]
    return f"clouds ({', '.join(words[:-1])} s) during the poses ({words[-1]} s)"


def _matched(
    by_topic: Sequence[Sequence[MessageTime]], time: MessageTime, match_s: float
) -> list[MessageTime | None]:
    """Return the cloud of each topic nearest to a time, None where that is too far."""
    found: list[MessageTime | None] = [time]
    for times in by_topic[1:]:
        stamps = np.array([one.stamp_ns for one in times])
        nearest = int(np.abs(stamps - time.stamp_ns).argmin())
        near = abs(times[nearest].stamp_ns - time.stamp_ns) <= match_s * SECOND_NS
        found.append(times[nearest] if near else None)
    return found


def _joined(offsets: Sequence[I64 | None]) -> I64 | None:
    known = [offset for offset in offsets if offset is not None]
    return np.concatenate(known) if len(known) == len(offsets) else None


def _stamp(message: Any) -> int:
    return int(message.header.stamp.sec) * SECOND_NS + int(message.header.stamp.nanosec)
