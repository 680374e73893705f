"""The frames of a scene to which boxes of a file belong: their names, times and poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from mottrack.core.arrays import I64, Texts
from mottrack.core.errors import DataError
from mottrack.core.frame import Frame
from mottrack.core.interfaces import Scene
from mottrack.core.pose import Pose

MAX_NUMBER_DIGITS = 6
"""A frame that is called by so few digits is counted within its scene, as KITTI's are."""


@dataclass(frozen=True)
class SceneFrames:
    """T frames in order of time.

    scene: name of the scene.
    names: of each frame, all names under which files know it: its token, its stamp, its sweep.
    stamp_ns: of each.
    world_T_ego: of each.
    ego_T_lidar: where detectors that report in the LiDAR's frame have it.
    """

    scene: str
    names: tuple[tuple[str, ...], ...]
    stamp_ns: tuple[int, ...]
    world_T_ego: tuple[Pose, ...]
    ego_T_lidar: Pose = field(default_factory=Pose.identity)

    @classmethod
    def of(cls, scene: str, frames: Sequence[Frame]) -> SceneFrames:
        """Return the frames as files know them: by token and by stamp."""
        return cls(
            scene,
            tuple(tuple(filter(None, (f.token, str(f.stamp_ns)))) for f in frames),
            tuple(f.stamp_ns for f in frames),
            tuple(f.world_T_ego for f in frames),
        )

    def numbered(self) -> SceneFrames:
        """Return the same frames, called by their place: 000000 is the first."""
        names = tuple((f"{i:06d}",) for i in range(len(self.names)))
        return replace(self, names=names)

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: i for i, names in enumerate(self.names) for name in names}

    def places(self, names: Sequence[str]) -> I64:
        """Return the index (N,) of the frame of each name, -1 for a name that is none's."""
        index = self._index
        return np.array([index.get(name, -1) for name in names], np.int64)

    @property
    def counted(self) -> bool:
        """Whether frames are called by numbers that another scene has too."""
        last = self.names[-1][0] if self.names else ""  # the first stamp may be 0
        return last.isdecimal() and len(last) <= MAX_NUMBER_DIGITS

    def places_of_keys(self, keys: Texts, path: Path) -> I64:
        """Return the index (N,) of the frame that each row of a table names.

        Raises:
            DataError: a row names no frame.
        """
        unique, inverse = np.unique(keys, return_inverse=True)
        found = self.places(unique.tolist())
        if (found < 0).any():
            self._refuse(path, str(unique[int(np.argmax(found < 0))]))
        return found[inverse].astype(np.int64)

    def rows_of_scene(self, keys: Texts, path: Path) -> I64:
        """Return which rows of a table without scenes are of this one.

        Raises:
            DataError: a stamp during the scene is that of none of its frames.
        """
        unique, inverse = np.unique(keys, return_inverse=True)
        found = self.places(unique.tolist())
        for key in unique[found < 0].tolist():
            stamp = int(key) if key.lstrip("-").isdecimal() else None
            if stamp is not None and self.stamp_ns[0] <= stamp <= self.stamp_ns[-1]:
                self._refuse(path, key)
        return np.flatnonzero((found >= 0)[inverse])

    def _refuse(self, path: Path, key: str) -> None:
        near = ", ".join(self.names[0][:2]) if self.names else "none"
        expected = f"a frame of {self.scene} (the first is {near}); float64 keeps no nanoseconds"
        raise DataError(path, "frame", key, expected)


def key_frames(scene: Scene) -> Iterator[Frame]:
    """Yield the frames of a scene at which trackers step, without its sweeps."""
    frames = (scene.frame(index) for index in range(len(scene)))
    return (frame for frame in frames if frame.is_key)
