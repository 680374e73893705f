"""Poses at the times of the sweeps, between two odometry messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core import Pose
from mottrack.core.arrays import F64
from mottrack.datasets.faults import MissingError
from mottrack.datasets.rigid import quaternion_pose


class Odometry:
    """The way of the vehicle: messages sorted by time."""

    def __init__(self, messages: list[Any], path: Path, max_gap_s: float) -> None:
        self._path, self._max_gap_ns = path, max_gap_s * 1e9
        rows = sorted(_row(message) for message in messages)
        self._stamp_ns = np.array([row[0] for row in rows], dtype=np.int64)
        self._values = np.array([row[1] for row in rows]).reshape(-1, 7)

    def at(self, stamp_ns: int) -> Pose:
        """Return `world_T_ego`: positions along the line, headings along the arc between two.

        Raises:
            DataError: no odometry before or after that time within the longest gap, or no pose.

        """
        after = int(np.searchsorted(self._stamp_ns, stamp_ns))
        if after < len(self._stamp_ns) and self._stamp_ns[after] == stamp_ns:
            return self._pose(self._values[after])
        if not 0 < after < len(self._stamp_ns) or self._gap_ns(after) > self._max_gap_ns:
            raise MissingError(self._path, "odometry", "missing", f"messages about {stamp_ns}")
        share = (stamp_ns - self._stamp_ns[after - 1]) / self._gap_ns(after)
        before, later = self._values[after - 1], self._values[after].copy()
        later[:4] *= np.sign(before[:4] @ later[:4]) or 1.0
        mixed = (1.0 - share) * before + share * later
        # over a gap of tenths of a second the chord's direction is the arc's
        mixed[:4] /= np.linalg.norm(mixed[:4])
        return self._pose(mixed)

    def _gap_ns(self, after: int) -> int:
        return int(self._stamp_ns[after] - self._stamp_ns[after - 1])

    def _pose(self, values: F64) -> Pose:
        return quaternion_pose(values[:4], values[4:], self._path, "odometry pose")


def _row(message: Any) -> tuple[int, list[float]]:
    stamp, pose = message.header.stamp, message.pose.pose
    turn, place = pose.orientation, pose.position
    values = [turn.w, turn.x, turn.y, turn.z, place.x, place.y, place.z]
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec), values
