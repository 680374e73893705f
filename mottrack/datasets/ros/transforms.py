"""The tree of frames that tf publishes, and poses between any two of them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mottrack.core import Pose
from mottrack.core.arrays import F64, I64
from mottrack.core.errors import DataError
from mottrack.core.sweep import SECOND_NS
from mottrack.datasets.ros.trajectory import (
    StampedPose,
    StampedPoses,
    composed,
    interpolated,
    inverted,
)
from mottrack.formats.checks import check_rotations, check_world_places
from mottrack.formats.columns import Columns
from mottrack.formats.faults import MissingError
from mottrack.formats.rigid import quaternion_pose

MOST_LINKS = 100
"""Of a chain of frames: vehicles have about ten, and a circle would have no end."""


class Link(NamedTuple):
    """How a frame hangs on its parent over time: `parent_T_child`."""

    parent: str
    poses: StampedPoses

    @property
    def moves(self) -> bool:
        """Whether it was published with different values."""
        return bool(np.ptp(self.poses.values, axis=0).any())

    @property
    def lasts(self) -> bool:
        """Whether it was published at more than one time, as that of a vehicle that waits."""
        return len(self.poses.stamp_ns) > 1


class Transforms:
    """The tree of frames of one log."""

    def __init__(self, messages: Iterable[Any], path: Path) -> None:
        rows: dict[str, list[StampedPose]] = {}
        parents: dict[str, str] = {}
        for message in messages:
            for one in message.transforms:
                child = frame_name(one.child_frame_id)
                parent = frame_name(one.header.frame_id)
                if parents.setdefault(child, parent) != parent:
                    found, expected = f"{parent} and {parents[child]}", "one parent"
                    raise DataError(path, f"parent of tf frame {child}", found, expected)
                pose = StampedPose(stamp_of(one.header), _values(one.transform))
                rows.setdefault(child, []).append(pose)
        self._path = path
        self._links = {
            child: Link(parents[child], _checked(StampedPoses.of(found), child, path))
            for child, found in rows.items()
        }

    def root_of(self, frame: str) -> str:
        """Return the uppermost frame above one."""
        return self._above(frame)[-1]

    def joined(self, one: str, other: str) -> bool:
        """Return whether a chain of transforms leads from one frame to the other."""
        return self.root_of(one) == self.root_of(other)

    def poses(self, world: str, ego: str) -> StampedPoses:
        """Return `world_T_ego` at every time at which a transform between the two is published.

        Raises:
            DataError: no chain of transforms joins them, or each was published once.
        """
        links = [self._links[name] for name in self._between(world, ego) if name in self._links]
        # a mounting that is published twice says nothing of when the vehicle was where
        chosen = [link for link in links if link.moves] or [link for link in links if link.lasts]
        moving = [link.poses.stamp_ns for link in chosen]
        if not moving:
            found = "published once" if links else "missing"
            expected = "dataset.world_frame and ego_frame of a vehicle that moves"
            raise MissingError(self._path, f"tf from {ego} to {world}", found, expected)
        first, last = max(s[0] for s in moving), min(s[-1] for s in moving)
        stamps = np.unique(np.concatenate(moving))
        stamps = stamps[(stamps >= first) & (stamps <= last)]
        return StampedPoses(stamps, self.relative(world, ego, stamps))

    def pose(self, target: str, source: str, stamp_ns: int) -> Pose:
        """Return `target_T_source` at a time; before and after the log as at its ends."""
        values = self.relative(target, source, np.array([stamp_ns], dtype=np.int64))[0]
        return quaternion_pose(values[:4], values[4:], self._path, f"tf from {source} to {target}")

    def relative(self, target: str, source: str, stamp_ns: I64) -> F64:
        """Return `target_T_source` (N, 7) at times (N,).

        Raises:
            DataError: no chain of transforms joins the frames.
        """
        if not self.joined(target, source):
            raise MissingError(self._path, f"tf from {source} to {target}", "missing", "a chain")
        return composed(inverted(self._to_root(target, stamp_ns)), self._to_root(source, stamp_ns))

    def _to_root(self, frame: str, stamp_ns: I64) -> F64:
        """Return `root_T_frame` (N, 7)."""
        found = np.tile([1.0, 0, 0, 0, 0, 0, 0], (len(stamp_ns), 1))
        for name in self._above(frame)[:-1]:
            poses = self._links[name].poses
            found = composed(interpolated(poses.stamp_ns, poses.values, stamp_ns), found)
        return found

    def _above(self, frame: str) -> list[str]:
        """Return a frame and those above it, the root last."""
        chain = [frame]
        while chain[-1] in self._links:
            chain.append(self._links[chain[-1]].parent)
            if len(chain) > MOST_LINKS:
                raise DataError(self._path, "tf above " + frame, "a circle", "a tree of frames")
        return chain

    def _between(self, one: str, other: str) -> set[str]:
        """Return the frames whose links lie between two: those above one of them alone."""
        return set(self._above(one)) ^ set(self._above(other))


def frame_name(text: str) -> str:
    """Return a frame's name without the stroke that ROS 1 wrote before it."""
    return str(text).removeprefix("/")


def stamp_of(header: Any) -> int:
    """Return the stamp of a header in nanoseconds.

    Raises:
        DataError: its nanoseconds make more than a second.
    """
    seconds, nanoseconds = int(header.stamp.sec), int(header.stamp.nanosec)
    if not 0 <= nanoseconds < SECOND_NS:
        raise ValueError(f"a stamp with {nanoseconds} nanoseconds")
    return seconds * SECOND_NS + nanoseconds


def _values(transform: Any) -> list[float]:
    q, t = transform.rotation, transform.translation
    return [q.w, q.x, q.y, q.z, t.x, t.y, t.z]


def _checked(poses: StampedPoses, child: str, path: Path) -> StampedPoses:
    """Return poses that are rotations and places on Earth."""
    table = Columns(
        path,
        {"rotation": poses.values[:, :4], "translation": poses.values[:, 4:]},
        poses.stamp_ns,
        lambda name, stamp: f"{name} of tf frame {child} at {stamp}",
    )
    table.refuse("translation", ~np.isfinite(poses.values), "finite numbers")
    check_rotations(table)
    check_world_places(table)
    unit = poses.values[:, :4] / np.linalg.norm(poses.values[:, :4], axis=1, keepdims=True)
    return StampedPoses(poses.stamp_ns, np.hstack([unit, poses.values[:, 4:]]))
