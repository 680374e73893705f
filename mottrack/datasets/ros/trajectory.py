"""Where a frame was in another over time, interpolated between stored poses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mottrack.core import Pose
from mottrack.core.arrays import F64, I64
from mottrack.core.sweep import SECOND_NS
from mottrack.formats.faults import MissingError
from mottrack.formats.rigid import quaternion_pose


class StampedPose(NamedTuple):
    """One pose: its time, and a quaternion w, x, y, z, then x, y, z in metres."""

    stamp_ns: int
    values: Sequence[float]


class StampedPoses(NamedTuple):
    """M poses: stamp_ns (M,), values (M, 7), a quaternion w, x, y, z, then x, y, z in metres."""

    stamp_ns: I64
    values: F64

    @classmethod
    def of(cls, poses: Sequence[StampedPose]) -> StampedPoses:
        """Return the poses sorted by time; of several at one time the first."""
        stamps = np.array([pose.stamp_ns for pose in poses], dtype=np.int64)
        values = np.array([pose.values for pose in poses], dtype=np.float64).reshape(-1, 7)
        unique, first = np.unique(stamps, return_index=True)
        return cls(unique, values[first])


class Trajectory:
    """`world_T_ego` over time: positions along the line, headings along the arc between two."""

    def __init__(self, poses: StampedPoses, path: Path, max_gap_s: float) -> None:
        self._path, self._max_gap_ns = path, max_gap_s * SECOND_NS
        self._stamp_ns, self._values = poses
        if not len(self._stamp_ns):
            raise MissingError(path, "poses", "none", "at least one")

    @property
    def first_ns(self) -> int:
        """Time of the first pose."""
        return int(self._stamp_ns[0])

    @property
    def last_ns(self) -> int:
        """Time of the last pose."""
        return int(self._stamp_ns[-1])

    def at(self, stamp_ns: int) -> Pose:
        """Return `world_T_ego` at a time between the first and the last pose.

        Raises:
            DataError: no pose before or after that time within the longest gap, or a damaged one.
        """
        after = int(np.searchsorted(self._stamp_ns, stamp_ns))
        if after < len(self._stamp_ns) and self._stamp_ns[after] == stamp_ns:
            return self._pose(self._values[after])
        if not 0 < after < len(self._stamp_ns) or self._gap_ns(after) > self._max_gap_ns:
            raise MissingError(self._path, "odometry", "missing", f"poses about {stamp_ns}")
        return self._pose(interpolated(self._stamp_ns, self._values, np.array([stamp_ns]))[0])

    def moved(self, xyz_m: F64, stamp_ns: I64, to_ns: int) -> F64:
        """Return points (N, 3), each measured in the ego frame of its own time, in that of one.

        A little before the first and after the last pose motion is continued: the points of the
        first revolution are measured before its stamp.
        """
        values = interpolated(self._stamp_ns, self._values, stamp_ns, beyond=True)
        return self.at(to_ns).inverse().apply(rotated(values[:, :4], xyz_m) + values[:, 4:])

    def _gap_ns(self, after: int) -> int:
        return int(self._stamp_ns[after] - self._stamp_ns[after - 1])

    def _pose(self, values: F64) -> Pose:
        return quaternion_pose(values[:4], values[4:], self._path, "odometry pose")


def interpolated(stamp_ns: I64, values: F64, wanted_ns: I64, *, beyond: bool = False) -> F64:
    """Return poses (N, 7) at the wanted times (N,), from stored ones (M,), (M, 7).

    Before the first and after the last they are those, or, if `beyond`, those of a motion that
    goes on.
    """
    if len(stamp_ns) == 1:
        return np.repeat(values, len(wanted_ns), axis=0)
    after = np.clip(np.searchsorted(stamp_ns, wanted_ns), 1, len(stamp_ns) - 1)
    gap = stamp_ns[after] - stamp_ns[after - 1]
    share = ((wanted_ns - stamp_ns[after - 1]) / gap)[:, None]
    if not beyond:
        share = np.clip(share, 0.0, 1.0)
    before, later = values[after - 1], values[after].copy()
    # q and -q are the same rotation: take the one on the side of the first
    turned = np.einsum("ni,ni->n", before[:, :4], later[:, :4]) < 0.0
    later[turned, :4] *= -1.0
    mixed: F64 = (1.0 - share) * before + share * later
    # over a gap of tenths of a second the chord's direction is the arc's
    mixed[:, :4] /= np.linalg.norm(mixed[:, :4], axis=1, keepdims=True)
    return mixed


def rotated(wxyz: F64, xyz: F64) -> F64:
    """Return vectors (N, 3), each turned by a unit quaternion (N, 4)."""
    w, axis = wxyz[:, :1], wxyz[:, 1:]
    turned: F64 = xyz + 2.0 * np.cross(axis, np.cross(axis, xyz) + w * xyz)
    return turned


def composed(a_T_b: F64, b_T_c: F64) -> F64:
    """Return `a_T_c` (N, 7) of two poses each (N, 7)."""
    p, q = a_T_b[:, :4], b_T_c[:, :4]
    scalar = p[:, 0] * q[:, 0] - np.einsum("ni,ni->n", p[:, 1:], q[:, 1:])
    axis = p[:, :1] * q[:, 1:] + q[:, :1] * p[:, 1:] + np.cross(p[:, 1:], q[:, 1:])
    place = rotated(p, b_T_c[:, 4:]) + a_T_b[:, 4:]
    return np.column_stack([scalar, axis, place])


def inverted(a_T_b: F64) -> F64:
    """Return `b_T_a` (N, 7)."""
    back = a_T_b[:, :4] * np.array([1.0, -1.0, -1.0, -1.0])
    return np.column_stack([back, -rotated(back, a_T_b[:, 4:])])
