"""Truth, tracks and flow of a whole scene as flat arrays: what a metric is a function of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F32, F64, I64, Mask, Texts
from mottrack.core.checks import as_array, require_all, require_finite
from mottrack.core.frame import Frame
from mottrack.core.objects import Tracks

Columns = dict[str, tuple[Any, tuple[int, ...]]]

ALL_AROUND_RAD = (-np.pi, np.pi)
BOX_COLUMNS: Columns = {
    "frame": (np.int64, ()),
    "id": (np.int64, ()),
    "label": (np.str_, ()),
    "centre_m": (np.float64, (3,)),
    "size_m": (np.float64, (3,)),
    "yaw_rad": (np.float64, ()),
    "velocity_mps": (np.float64, (2,)),
}


class Table:
    """Columns of equal length, checked when made."""

    COLUMNS: ClassVar[Columns] = {}
    MAY_BE_NAN: ClassVar[frozenset[str]] = frozenset()

    def __post_init__(self) -> None:
        """Checks every column.

        Raises:
            InputError: a shape is wrong or a number is not finite.
        """
        first, (dtype, tail) = next(iter(self.COLUMNS.items()))
        n = len(as_array(first, getattr(self, first), dtype, (None, *tail)))
        for name, (dtype, tail) in self.COLUMNS.items():
            array = as_array(name, getattr(self, name), dtype, (n, *tail))
            if np.issubdtype(array.dtype, np.floating) and name not in self.MAY_BE_NAN:
                require_finite(name, array)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(getattr(self, next(iter(self.COLUMNS))))

    @classmethod
    def empty(cls) -> Self:
        """A table without rows."""
        return cls(**{n: np.zeros((0, *tail), dtype=d) for n, (d, tail) in cls.COLUMNS.items()})

    def select(self, index: NDArray[Any]) -> Self:
        """The rows that a boolean mask or an integer index picks."""
        return type(self)(**{name: getattr(self, name)[index] for name in self.COLUMNS})

    @classmethod
    def stacked(cls, parts: Sequence[Self]) -> Self:
        """One table with the rows of all parts, in order."""
        if not parts:
            return cls.empty()
        return cls(**{n: np.concatenate([getattr(p, n) for p in parts]) for n in cls.COLUMNS})


@dataclass(frozen=True, slots=True)
class FrameTable(Table):
    """The key frames of a scene, in order of time."""

    COLUMNS: ClassVar[Columns] = {
        "stamp_ns": (np.int64, ()),
        "token": (np.str_, ()),
        "world_T_ego": (np.float64, (4, 4)),
        "labelled_azimuth_rad": (np.float64, (2,)),
        "annotated": (np.bool_, ()),
    }

    stamp_ns: I64
    """(T,) time of the frame."""
    token: Texts
    """(T,) the data set's own name of the frame."""
    world_T_ego: F64
    """(T, 4, 4) pose of the vehicle."""
    labelled_azimuth_rad: F64
    """(T, 2) right and left azimuth, ego frame, between which objects are labelled."""
    annotated: Mask
    """(T,) false where nobody labelled anything: there a track is neither right nor wrong."""

    def __post_init__(self) -> None:
        """Checks every column, and that the stamps ascend.

        Raises:
            InputError: a shape is wrong, a number is not finite, or a stamp is not later than the
                one before it.
        """
        Table.__post_init__(self)
        later = np.ones(len(self), np.bool_)
        later[1:] = self.stamp_ns[1:] > self.stamp_ns[:-1]
        require_all("stamp_ns", self.stamp_ns, later, "later than the one before it")

    @classmethod
    def of(cls, frames: Sequence[Frame]) -> FrameTable:
        """The table of these frames."""
        return cls(
            np.array([f.stamp_ns for f in frames], dtype=np.int64),
            np.array([f.token for f in frames], dtype=np.str_),
            np.array([f.world_T_ego.matrix for f in frames]).reshape(-1, 4, 4),
            np.array([f.labelled_azimuth_rad or ALL_AROUND_RAD for f in frames]).reshape(-1, 2),
            np.array([f.truth is not None for f in frames], dtype=np.bool_),
        )

    def labelled(self, frame: I64, centre_m: F64) -> Mask:
        """(N,) whether boxes lie where objects are labelled.

        Args:
            frame: (N,) row of this table that each box belongs to.
            centre_m: (N, 3) centre of each box, world frame.
        """
        world_T_ego = self.world_T_ego[frame]
        from_ego = centre_m - world_T_ego[:, :3, 3]
        x, y = np.einsum("nij,ni->jn", world_T_ego[:, :3, :2], from_ego)
        azimuth = np.arctan2(y, x)
        right, left = self.labelled_azimuth_rad[frame].T
        inside: Mask = (azimuth >= right) & (azimuth <= left)
        return inside & self.annotated[frame]


@dataclass(frozen=True, slots=True)
class TruthTable(Table):
    """True boxes of a scene, world frame, with the columns of `Truth`.

    ``frame`` is the row of the FrameTable.
    """

    COLUMNS: ClassVar[Columns] = {
        **BOX_COLUMNS,
        "num_points": (np.int64, ()),
        "interpolated": (np.bool_, ()),
    }
    MAY_BE_NAN: ClassVar[frozenset[str]] = frozenset({"velocity_mps"})

    frame: I64
    id: I64
    label: Texts
    centre_m: F64
    size_m: F64
    yaw_rad: F64
    velocity_mps: F64
    num_points: I64
    interpolated: Mask

    @classmethod
    def of(cls, frames: Sequence[Frame]) -> TruthTable:
        """The table of the truth of these frames; a frame without truth has no rows."""
        parts = []
        for index, frame in enumerate(frames):
            if frame.truth is not None:
                rows = {f.name: getattr(frame.truth, f.name) for f in fields(cls)[1:]}
                parts.append(cls(frame=np.full(len(frame.truth), index), **rows))
        return cls.stacked(parts)


@dataclass(frozen=True, slots=True)
class TrackTable(Table):
    """Tracks of a scene, world frame, with columns of `Tracks`.

    ``frame`` is the row of the FrameTable.
    """

    COLUMNS: ClassVar[Columns] = {
        **BOX_COLUMNS,
        "velocity_covariance_m2ps2": (np.float64, (2, 2)),
        "score": (np.float64, ()),
        "observed": (np.bool_, ()),
        "hull_corners": (np.int64, ()),
    }

    frame: I64
    id: I64
    label: Texts
    centre_m: F64
    size_m: F64
    yaw_rad: F64
    velocity_mps: F64
    velocity_covariance_m2ps2: F64
    score: F64
    observed: Mask
    hull_corners: I64
    """(N,) corners of the convex hull in SceneResult.hull_xy_m, in order; 0: the box is meant."""

    @classmethod
    def of(cls, steps: Sequence[Tracks]) -> TrackTable:
        """The table of what a tracker returned, step by step."""
        parts = []
        names = set(cls.COLUMNS) - {"frame", "velocity_covariance_m2ps2", "hull_corners"}
        for index, tracks in enumerate(steps):
            rows = {name: getattr(tracks, name) for name in names}
            hull = tracks.hull or ()
            corners = [len(h) for h in hull] if hull else [0] * len(tracks)
            parts.append(
                cls(
                    frame=np.full(len(tracks), index),
                    velocity_covariance_m2ps2=tracks.velocity_covariance_m2ps2,
                    hull_corners=np.array(corners, dtype=np.int64),
                    **rows,
                )
            )
        return cls.stacked(parts)


@dataclass(frozen=True, slots=True)
class FlowSamples(Table):
    """Estimated and true velocity of every occupied, labelled cell of a scene."""

    COLUMNS: ClassVar[Columns] = {
        "frame": (np.int64, ()),
        "xy_m": (np.float32, (2,)),
        "estimate_mps": (np.float32, (2,)),
        "truth_mps": (np.float32, (2,)),
        "dt_s": (np.float32, ()),
        "valid": (np.bool_, ()),
        "dynamic": (np.bool_, ()),
        "observable": (np.bool_, ()),
    }

    frame: I64
    """(K,) row of the FrameTable."""
    xy_m: F32
    """(K, 2) centre of the cell, ego frame."""
    estimate_mps: F32
    """(K, 2) the source's velocity, ego axes; 0 where it measured none."""
    truth_mps: F32
    """(K, 2) true velocity, ego axes."""
    dt_s: F32
    """(K,) time between the two sweeps, seconds: velocity times this is the flow in metres."""
    valid: Mask
    """(K,) whether the source measured the cell."""
    dynamic: Mask
    """(K,) whether the cell belongs to an object of a movable class that moves."""
    observable: Mask
    """(K,) whether the cell's object was hit in both sweeps (background: always)."""
