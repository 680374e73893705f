"""Boxes at one stamp: detections or clusters, tracks, truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.core.checks import (
    as_array,
    as_stamp,
    require_all,
    require_covariance,
    require_finite,
    require_instance,
)
from mottrack.core.errors import InputError
from mottrack.core.motion import VelocityMeasurement
from mottrack.core.pose import Pose, rotation_2d, wrap_angle

FRAMES = ("world", "ego")
Hulls = tuple[F64, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Boxes:
    """N boxes at one stamp, in one frame, as a structure of arrays.

    Raises:
        InputError: a shape is wrong, a number is not finite, or a size is not positive.
    """

    ROWS: ClassVar[dict[str, tuple[Any, tuple[int, ...]]]] = {
        "centre_m": (np.float64, (3,)),
        "size_m": (np.float64, (3,)),
        "yaw_rad": (np.float64, ()),
    }
    MAY_BE_NAN: ClassVar[frozenset[str]] = frozenset()

    stamp_ns: int
    frame: str = "world"
    """``"world"`` (fixed to the ground) or ``"ego"`` (x forward, y left, z up)."""
    centre_m: F64
    """(N, 3) centre of the box."""
    size_m: F64
    """(N, 3) length, width, height."""
    yaw_rad: F64
    """(N,) heading about +z; zero is along +x."""
    label: Texts
    """(N,) class name."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", as_stamp("stamp_ns", self.stamp_ns))
        if self.frame not in FRAMES:
            raise InputError("frame", repr(self.frame), f"one of {', '.join(FRAMES)}")
        n = len(as_array("centre_m", self.centre_m, np.float64, (None, 3)))
        for name, (dtype, tail) in self._all_rows().items():
            array = as_array(name, getattr(self, name), dtype, (n, *tail))
            if dtype is np.float64 and name not in self.MAY_BE_NAN:
                require_finite(name, array)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "label", as_array("label", self.label, np.str_, (n,)))
        require_all("size_m", self.size_m, self.size_m > 0, "a positive number of metres")

    @classmethod
    def _all_rows(cls) -> dict[str, tuple[Any, tuple[int, ...]]]:
        rows: dict[str, tuple[Any, tuple[int, ...]]] = {}
        for base in reversed(cls.__mro__):
            rows |= base.__dict__.get("ROWS", {})
        return rows

    def __len__(self) -> int:
        return len(self.centre_m)

    def select(self, index: NDArray[Any]) -> Self:
        """The rows that a boolean mask or an integer index picks, in that order."""
        picked = np.arange(len(self))[index]
        changes: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                changes[item.name] = value[picked]
            elif isinstance(value, VelocityMeasurement):
                changes[item.name] = value.select(picked)
            elif isinstance(value, tuple):
                changes[item.name] = tuple(value[i] for i in picked)
        return replace(self, **changes)

    def transformed(self, b_T_a: Pose, frame: str) -> Self:
        """The same boxes in another frame; headings and velocities turn by the pose's yaw.

        Args:
            b_T_a: pose that takes this frame's points to the new frame's.
            frame: name of the new frame, ``"world"`` or ``"ego"``.
        """
        return replace(self, frame=frame, **self._moved(b_T_a))

    def _moved(self, b_T_a: Pose) -> dict[str, Any]:
        return {
            "centre_m": b_T_a.apply(self.centre_m),
            "yaw_rad": wrap_angle(self.yaw_rad + b_T_a.yaw_rad),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Objects(Boxes):
    """What a detector or a clustering reports at one stamp, with measured velocity or without."""

    ROWS: ClassVar[dict[str, tuple[Any, tuple[int, ...]]]] = {"score": (np.float64, ())}

    score: F64
    """(N,) confidence; higher is surer."""
    velocity: VelocityMeasurement | None = None
    """Measured velocities in the axes of ``frame``; None where no source was asked."""
    hull: Hulls | None = None
    """For clusters: per object (K, 2) corners of the convex hull, counter-clockwise."""
    position_covariance_m2: F64 | None = None
    """(N, 2, 2) covariance of the error of ``centre_m`` in x, y; None where the source has none."""
    num_points: I64 | None = None
    """(N,) LiDAR returns on the object; None where not counted."""

    def __post_init__(self) -> None:
        # zero-argument super() does not work in a dataclass with slots
        Boxes.__post_init__(self)
        if self.position_covariance_m2 is not None:
            spread = as_array(
                "position_covariance_m2", self.position_covariance_m2, np.float64, (len(self), 2, 2)
            )
            require_covariance("position_covariance_m2", spread)
            object.__setattr__(self, "position_covariance_m2", spread)
        if self.num_points is not None:
            counted = as_array("num_points", self.num_points, np.int64, (len(self),))
            object.__setattr__(self, "num_points", counted)
        if self.velocity is not None:
            require_instance("velocity", self.velocity, VelocityMeasurement)
            if len(self.velocity) != len(self):
                raise InputError("length of velocity", len(self.velocity), str(len(self)))
        object.__setattr__(self, "hull", _checked_hull(self.hull, len(self)))

    @classmethod
    def empty(cls, stamp_ns: int, frame: str = "world") -> Objects:
        """Nothing detected."""
        return cls(stamp_ns=stamp_ns, frame=frame, score=np.zeros(0), **_no_boxes())

    def with_velocity(self, velocity: VelocityMeasurement | None) -> Objects:
        """The same objects with these measured velocities."""
        return replace(self, velocity=velocity)

    def _moved(self, b_T_a: Pose) -> dict[str, Any]:
        changes = Boxes._moved(self, b_T_a)
        if self.velocity is not None:
            changes["velocity"] = self.velocity.rotated(b_T_a.yaw_rad)
        if self.position_covariance_m2 is not None:
            r = rotation_2d(b_T_a.yaw_rad)
            changes["position_covariance_m2"] = r @ self.position_covariance_m2 @ r.T
        return changes | {"hull": _moved_hull(self.hull, self.centre_m, b_T_a)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracks(Boxes):
    """What a tracker believes at one stamp."""

    ROWS: ClassVar[dict[str, tuple[Any, tuple[int, ...]]]] = {
        "id": (np.int64, ()),
        "score": (np.float64, ()),
        "velocity_mps": (np.float64, (2,)),
        "velocity_covariance_m2ps2": (np.float64, (2, 2)),
        "observed": (np.bool_, ()),
    }

    id: I64
    """(N,) identity, unique within the scene."""
    score: F64
    """(N,) confidence of the track."""
    velocity_mps: F64
    """(N, 2) velocity over the ground in the axes of ``frame``."""
    velocity_covariance_m2ps2: F64
    """(N, 2, 2) covariance of its error."""
    state: F64
    """(N, D) mean of the tracker's own state."""
    covariance: F64
    """(N, D, D) covariance of the tracker's own state."""
    observed: Mask
    """(N,) whether the track was seen at this stamp; false while it coasts."""
    hull: Hulls | None = None
    """For clusters: per track (K, 2) corners of the convex hull."""

    def __post_init__(self) -> None:
        Boxes.__post_init__(self)
        n = len(self)
        state = as_array("state", self.state, np.float64, (n, None))
        d = state.shape[1]
        covariance = as_array("covariance", self.covariance, np.float64, (n, d, d))
        require_finite("state", state)
        require_finite("covariance", covariance)
        identities, counts = np.unique(self.id, return_counts=True)
        if len(identities) != n:
            twice = int(identities[np.argmax(counts)])
            raise InputError("id", f"{twice} for {counts.max()} tracks", "no identity twice")
        object.__setattr__(self, "state", state)
        object.__setattr__(self, "covariance", covariance)
        object.__setattr__(self, "hull", _checked_hull(self.hull, n))

    @classmethod
    def empty(cls, stamp_ns: int, frame: str = "world", dimensions: int = 0) -> Tracks:
        """No track, of a tracker with a state of that many dimensions."""
        return cls(
            stamp_ns=stamp_ns,
            frame=frame,
            id=np.zeros(0, dtype=np.int64),
            score=np.zeros(0),
            velocity_mps=np.zeros((0, 2)),
            velocity_covariance_m2ps2=np.zeros((0, 2, 2)),
            state=np.zeros((0, dimensions)),
            covariance=np.zeros((0, dimensions, dimensions)),
            observed=np.zeros(0, dtype=np.bool_),
            **_no_boxes(),
        )

    def _moved(self, b_T_a: Pose) -> dict[str, Any]:
        changes = Boxes._moved(self, b_T_a)
        r = rotation_2d(b_T_a.yaw_rad)
        changes["velocity_mps"] = self.velocity_mps @ r.T
        changes["velocity_covariance_m2ps2"] = r @ self.velocity_covariance_m2ps2 @ r.T
        return changes | {"hull": _moved_hull(self.hull, self.centre_m, b_T_a)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth(Boxes):
    """What annotators (or the embedded world) say was there at one stamp."""

    ROWS: ClassVar[dict[str, tuple[Any, tuple[int, ...]]]] = {
        "id": (np.int64, ()),
        "velocity_mps": (np.float64, (2,)),
        "num_points": (np.int64, ()),
        "interpolated": (np.bool_, ()),
    }
    MAY_BE_NAN: ClassVar[frozenset[str]] = frozenset({"velocity_mps"})

    id: I64
    """(N,) identity, unique within the scene."""
    velocity_mps: F64
    """(N, 2) velocity over the ground in the axes of ``frame``; NaN where the labels do not tell
    (a track of one box, a gap that is too long)."""
    num_points: I64
    """(N,) LiDAR returns on the object; -1 where not counted."""
    interpolated: Mask
    """(N,) whether the box was interpolated between two annotated stamps."""

    @classmethod
    def empty(cls, stamp_ns: int, frame: str = "world") -> Truth:
        """Nothing annotated."""
        return cls(
            stamp_ns=stamp_ns,
            frame=frame,
            id=np.zeros(0, dtype=np.int64),
            velocity_mps=np.zeros((0, 2)),
            num_points=np.zeros(0, dtype=np.int64),
            interpolated=np.zeros(0, dtype=np.bool_),
            **_no_boxes(),
        )

    def _moved(self, b_T_a: Pose) -> dict[str, Any]:
        velocity_mps = self.velocity_mps @ rotation_2d(b_T_a.yaw_rad).T
        return Boxes._moved(self, b_T_a) | {"velocity_mps": velocity_mps}


def _no_boxes() -> dict[str, Any]:
    return {
        "centre_m": np.zeros((0, 3)),
        "size_m": np.zeros((0, 3)),
        "yaw_rad": np.zeros(0),
        "label": np.zeros(0, dtype=np.str_),
    }


def _checked_hull(hull: Hulls | None, n: int) -> Hulls | None:
    if hull is None:
        return None
    if not isinstance(hull, Sequence):
        raise InputError("hull", f"of type {type(hull).__name__}", "a tuple of (K, 2) arrays")
    if len(hull) != n:
        raise InputError("length of hull", len(hull), str(n))
    checked = tuple(
        h if _is_checked(h) else as_array(f"hull[{i}]", h, np.float64, (None, 2))
        for i, h in enumerate(hull)
    )
    if n and not np.isfinite(np.concatenate(checked)).all():
        for i, h in enumerate(checked):
            require_finite(f"hull[{i}]", h)
    return checked


def _is_checked(hull: F64) -> bool:
    """Whether `as_array` would return the same; hundreds of hulls pass through every frame."""
    if not isinstance(hull, np.ndarray) or hull.flags.writeable or hull.dtype != np.float64:
        return False
    return hull.ndim == 2 and hull.shape[1] == 2


def _moved_hull(hull: Hulls | None, centre_m: F64, b_T_a: Pose) -> Hulls | None:
    """Moves hulls with the pose; each hull lies at its box's height."""
    if hull is None:
        return None
    heights = centre_m[:, 2]
    return tuple(
        b_T_a.apply(np.column_stack([h, np.full(len(h), z)]))[:, :2]
        for h, z in zip(hull, heights, strict=True)
    )
