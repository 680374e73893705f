"""Truth, tracks and flow samples of a whole scene as flat arrays: the input of every metric."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F32, F64, I64, Mask, Texts
from mottrack.core.checks import Column, Columns, require_all, set_columns
from mottrack.core.data_frames import Tabular, flattened
from mottrack.core.frame import Frame
from mottrack.core.objects import Tracks

ALL_AROUND_RAD = (-np.pi, np.pi)


class Table(Tabular):
    """Columns of equal length, checked on construction."""

    COLUMNS: ClassVar[Columns] = {}
    MAY_BE_NAN: ClassVar[frozenset[str]] = frozenset()

    def __post_init__(self) -> None:
        """Check every column.

        Raises:
            InputError: a shape is wrong or a number is not finite.
        """
        set_columns(self, self.COLUMNS, self.MAY_BE_NAN)

    def __len__(self) -> int:
        return len(getattr(self, next(iter(self.COLUMNS))))

    def flat(self) -> dict[str, NDArray[Any]]:
        """Return the columns by name, (N,) each: a vector is a column for each of its numbers."""
        return flattened({name: getattr(self, name) for name in self.COLUMNS})

    @classmethod
    def empty(cls) -> Self:
        """Return a table without rows."""
        return cls(**{n: np.zeros((0, *c.shape), c.dtype) for n, c in cls.COLUMNS.items()})

    def select(self, index: NDArray[Any]) -> Self:
        """Return the rows that a boolean mask or an integer index picks."""
        return type(self)(**{name: getattr(self, name)[index] for name in self.COLUMNS})

    @classmethod
    def stacked(cls, parts: Sequence[Self]) -> Self:
        """Return one table with the rows of all parts, in order."""
        if not parts:
            return cls.empty()
        return cls(**{n: np.concatenate([getattr(p, n) for p in parts]) for n in cls.COLUMNS})


@dataclass(frozen=True, slots=True)
class FrameTable(Table):
    """The key frames of a scene, in order of time."""

    COLUMNS: ClassVar[Columns] = {
        "stamp_ns": Column(np.int64),
        "token": Column(np.str_),
        "world_T_ego": Column(np.float64, (4, 4)),
        "labelled_azimuth_rad": Column(np.float64, (2,)),
        "annotated": Column(np.bool_),
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
    """(T,) false where the frame has no labels: there a track is neither right nor wrong."""

    def __post_init__(self) -> None:
        """Check every column, and that the stamps ascend.

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
        """Make the table of these frames."""
        return cls(
            np.array([f.stamp_ns for f in frames], dtype=np.int64),
            np.array([f.token for f in frames], dtype=np.str_),
            np.array([f.world_T_ego.matrix for f in frames]).reshape(-1, 4, 4),
            np.array([f.labelled_azimuth_rad or ALL_AROUND_RAD for f in frames]).reshape(-1, 2),
            np.array([f.truth is not None for f in frames], dtype=np.bool_),
        )

    def labelled(self, frame: I64, centre_m: F64) -> Mask:
        """Return (N,) whether boxes lie where objects are labelled.

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
class BoxTable(Table):
    """Boxes of a scene, world frame; shapes and units are those of `Tracks` and `Truth`."""

    COLUMNS: ClassVar[Columns] = {
        "frame": Column(np.int64),
        "id": Column(np.int64),
        "label": Column(np.str_),
        "centre_m": Column(np.float64, (3,)),
        "size_m": Column(np.float64, (3,)),
        "yaw_rad": Column(np.float64),
        "velocity_mps": Column(np.float64, (2,)),
    }

    frame: I64
    """(N,) row of the FrameTable."""
    id: I64
    label: Texts
    centre_m: F64
    size_m: F64
    yaw_rad: F64
    velocity_mps: F64


@dataclass(frozen=True, slots=True)
class TruthTable(BoxTable):
    """True boxes of a scene, with the columns of `Truth`."""

    COLUMNS: ClassVar[Columns] = {
        **BoxTable.COLUMNS,
        "num_points": Column(np.int64),
        "interpolated": Column(np.bool_),
    }
    MAY_BE_NAN: ClassVar[frozenset[str]] = frozenset({"velocity_mps"})

    num_points: I64
    interpolated: Mask

    @classmethod
    def of(cls, frames: Sequence[Frame]) -> TruthTable:
        """Make the table of the truth of these frames; a frame without truth has no rows."""
        parts = []
        for index, frame in enumerate(frames):
            if frame.truth is not None:
                rows = {f.name: getattr(frame.truth, f.name) for f in fields(cls)[1:]}
                parts.append(cls(frame=np.full(len(frame.truth), index), **rows))
        return cls.stacked(parts)


@dataclass(frozen=True, slots=True)
class TrackTable(BoxTable):
    """Tracks of a scene, with columns of `Tracks`."""

    COLUMNS: ClassVar[Columns] = {
        **BoxTable.COLUMNS,
        "velocity_covariance_m2ps2": Column(np.float64, (2, 2)),
        "score": Column(np.float64),
        "observed": Column(np.bool_),
        "hull_corners": Column(np.int64),
    }
    MAY_BE_NAN: ClassVar[frozenset[str]] = frozenset({"velocity_mps"})
    """Trackers of others may report no velocity."""

    velocity_covariance_m2ps2: F64
    score: F64
    observed: Mask
    hull_corners: I64
    """(N,) number of hull corners in SceneResult.hull_xy_m; 0 where the track has only a box."""

    @classmethod
    def of(cls, steps: Sequence[Tracks]) -> TrackTable:
        """Make the table of what a tracker returned, step by step."""
        parts = []
        names = set(cls.COLUMNS) - {"frame", "hull_corners"}
        for index, tracks in enumerate(steps):
            rows = {name: getattr(tracks, name) for name in names}
            corners = [len(h) for h in tracks.hull] if tracks.hull else [0] * len(tracks)
            parts.append(
                cls(frame=np.full(len(tracks), index), hull_corners=np.array(corners), **rows)
            )
        return cls.stacked(parts)


@dataclass(frozen=True, slots=True)
class FlowSamples(Table):
    """Estimated and true velocity of every occupied, labelled cell of a scene."""

    COLUMNS: ClassVar[Columns] = {
        "frame": Column(np.int64),
        "xy_m": Column(np.float32, (2,)),
        "estimate_mps": Column(np.float32, (2,)),
        "truth_mps": Column(np.float32, (2,)),
        "dt_s": Column(np.float32),
        "valid": Column(np.bool_),
        "dynamic": Column(np.bool_),
        "movable": Column(np.bool_),
        "observable": Column(np.bool_),
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
    """(K,) whether the cell belongs to an object faster than `core.motion.MOVING_MPS`."""
    movable: Mask
    """(K,) whether it belongs to an object of a class that is tracked, moving or parked."""
    observable: Mask
    """(K,) whether the cell's object was hit in both sweeps (background: always)."""
