"""Boxes and samples of many scenes as flat arrays."""

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I8, I64, Texts


@dataclass(frozen=True, slots=True)
class Samples:
    """Key frames of S scenes; row k of scene s is its k-th sample in time."""

    scene_name: Texts
    """(S,)"""
    first: I64
    """(S + 1,) first sample of each scene, and the end."""
    token: Texts
    """(N,) sample token."""
    stamp_us: I64
    """(N,) microseconds."""
    ego_xy_m: F64
    """(N, 2) ego position at the LiDAR key frame."""

    @property
    def scenes(self) -> int:
        """Number of scenes."""
        return len(self.scene_name)

    def __len__(self) -> int:
        return len(self.token)

    def scene_of_sample(self) -> I64:
        """Return the scene of each sample, (N,)."""
        return np.repeat(np.arange(self.scenes), np.diff(self.first))


@dataclass(frozen=True, slots=True)
class BoxTable:
    """N boxes; truth or predictions.

    `sample` counts through all scenes. `track` numbers the (scene, id) pairs: one id in two scenes
    is two tracks.
    """

    sample: I64
    """(N,)"""
    track: I64
    """(N,)"""
    label: I8
    """(N,) index into the classes of the rules."""
    centre_m: F64
    """(N, 3) global frame."""
    score: F64
    """(N,) of the track, once prepared; -1 for truth."""
    num_points: I64
    """(N,) points in the box, -1 where not known."""

    def __len__(self) -> int:
        return len(self.sample)

    def select(self, index: NDArray[Any]) -> "BoxTable":
        """Return the rows that a mask or index picks."""
        return BoxTable(*(getattr(self, f.name)[index] for f in fields(self)))

    def with_score(self, score: F64) -> "BoxTable":
        """Return the same boxes with other scores."""
        return replace(self, score=score)

    @classmethod
    def stacked(cls, *parts: "BoxTable") -> "BoxTable":
        """Return one table with all rows."""
        names = [f.name for f in fields(cls)]
        return cls(*(np.concatenate([getattr(part, n) for part in parts]) for n in names))


@dataclass(frozen=True, slots=True)
class Racks:
    """Bicycle racks, within which bicycles and motorcycles are not evaluated."""

    sample: I64
    """(R,)"""
    centre_m: F64
    """(R, 3)"""
    size_m: F64
    """(R, 3) width, length, height, as in the tables."""
    rotation_wxyz: F64
    """(R, 4)"""

    @classmethod
    def none(cls) -> "Racks":
        """Return an empty table."""
        return cls(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 4)))


@dataclass(frozen=True, slots=True)
class Bodies:
    """N boxes from above with their velocities: what the velocity error is computed from."""

    sample: I64
    """(N,) ascending."""
    bev: F64
    """(N, 5) centre x, y, length, width, heading; global frame, metres and radians."""
    velocity_mps: F64
    """(N, 2) NaN where unknown."""
    label: I64
    """(N,) index into `names`."""
    names: Texts
    """(K,) classes; of true boxes also categories that are not tracked."""

    @classmethod
    def none(cls) -> "Bodies":
        """Return an empty table."""
        index = np.zeros(0, np.int64)
        return cls(index, np.zeros((0, 5)), np.zeros((0, 2)), index, np.zeros(0, np.str_))


@dataclass(frozen=True, slots=True)
class GroundTruth:
    """What predictions are compared with: samples, true boxes as annotated, racks."""

    samples: Samples
    boxes: BoxTable
    racks: Racks
    bodies: Bodies = field(default_factory=Bodies.none)
    """All annotated boxes, those of other categories too."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """Truth and predictions after filter, score averaging and interpolation, by sample."""

    samples: Samples
    truth: BoxTable
    tracks: BoxTable
