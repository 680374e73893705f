"""Boxes at one stamp: detections or clusters, tracks, truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.core.checks import (
    MAX_PLACE_M,
    Column,
    Columns,
    as_array,
    require_all,
    require_covariance,
    require_finite,
    require_instance,
    require_within,
    set_array,
    set_columns,
    set_stamp,
)
from mottrack.core.data_frames import Tabular, flattened
from mottrack.core.errors import InputError
from mottrack.core.motion import VelocityMeasurement
from mottrack.core.pictures import INK, TRACK, Plan, captioned, footprints
from mottrack.core.pose import Pose, rotation_2d, wrap_angle
from mottrack.core.sweep import SECOND_NS

FRAMES = ("world", "ego")
Hulls = tuple[F64, ...]


MAX_SIZE_M = 1e5
"""No object is 100 km long: such a size is a damaged number."""
MAX_YAW_RAD = 1e6
"""Headings may be unwrapped over hours; a larger one has lost its digits of the angle."""
MAX_SCORE = 1e9
"""Scores may be logits or sums of returns; squares and sums of larger ones overflow at last."""
MAX_COVARIANCE = 1e12
"""(1000 km)^2, (1000 km/s)^2: nothing is known of what is more uncertain."""
GENERIC = "generic"
"""Label of an object that is not classified: a cluster."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Boxes(Tabular):
    """N boxes at one stamp, in one frame, as a structure of arrays.

    Raises:
        InputError: a shape is wrong, a number is not finite, or a size is not positive.
    """

    COLUMNS: ClassVar[Columns] = {
        "centre_m": Column(np.float64, (3,)),
        "size_m": Column(np.float64, (3,)),
        "yaw_rad": Column(np.float64),
        "label": Column(np.str_),
    }
    """Arrays that every box of the class has; a subclass lists its own beside these."""
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
        set_stamp(self)
        if self.frame not in FRAMES:
            raise InputError("frame", repr(self.frame), f"one of {', '.join(FRAMES)}")
        set_columns(self, self.COLUMNS, self.MAY_BE_NAN)
        require_within("centre_m", self.centre_m, MAX_PLACE_M, "m")
        require_within("size_m", self.size_m, MAX_SIZE_M, "m")
        require_within("yaw_rad", self.yaw_rad, MAX_YAW_RAD, "rad")
        require_all("size_m", self.size_m, self.size_m > 0, "a positive number of metres")

    @classmethod
    def empty(cls, stamp_ns: int, frame: str = "world") -> Self:
        """Return no box."""
        return cls(stamp_ns=stamp_ns, frame=frame, **cls._no_rows())

    @classmethod
    def _no_rows(cls) -> dict[str, Any]:
        return {name: np.zeros((0, *c.shape), c.dtype) for name, c in cls.COLUMNS.items()}

    def __len__(self) -> int:
        return len(self.centre_m)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._about()})"

    def _about(self) -> str:
        kinds = np.unique(self.label, return_counts=True)
        counts = ", ".join(f"{count} {name}" for name, count in zip(*kinds, strict=True))
        return f"{counts or 'none'} at {self.stamp_ns / SECOND_NS:.3f} s, {self.frame} frame"

    def _repr_html_(self) -> str:
        """Return a picture seen from above, for notebooks."""
        return captioned(repr(self), self._plan().markup())

    def _plan(self) -> Plan:
        outlines = footprints(self.centre_m, self.size_m, self.yaw_rad)
        plan = Plan(np.concatenate(outlines) if outlines else np.zeros((0, 2)))
        for outline in outlines:
            plan.polygon(outline, TRACK)
        return plan

    def flat(self) -> dict[str, NDArray[Any]]:
        """Return the stamp and `COLUMNS` by name, (N,) each, a column for each number."""
        stamp_ns = np.full(len(self), self.stamp_ns)
        columns = {name: getattr(self, name) for name in self.COLUMNS}
        return {"stamp_ns": stamp_ns, **flattened(columns)}

    def select(self, index: NDArray[Any]) -> Self:
        """Return the rows that a boolean mask or an integer index picks, in that order."""
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
        """Return the same boxes in another frame; yaw and velocities rotate by the pose's yaw.

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
    """Boxes of a detector or a clustering at one stamp, with measured velocities or without."""

    COLUMNS: ClassVar[Columns] = {**Boxes.COLUMNS, "score": Column(np.float64)}

    score: F64
    """(N,) confidence; higher is more certain."""
    velocity: VelocityMeasurement | None = None
    """Measured velocities in the axes of ``frame``; None where no source measures any."""
    hull: Hulls | None = None
    """For clusters: per object (K, 2) corners of the convex hull, counter-clockwise."""
    position_covariance_m2: F64 | None = None
    """(N, 2, 2) covariance of the error of ``centre_m`` in x, y; None where the source has none."""
    num_points: I64 | None = None
    """(N,) LiDAR returns on the object; None where not counted."""

    def __post_init__(self) -> None:
        # zero-argument super() does not work in a dataclass with slots
        Boxes.__post_init__(self)
        n = len(self)
        require_within("score", self.score, MAX_SCORE, "")
        if self.position_covariance_m2 is not None:
            covariance = set_array(self, "position_covariance_m2", np.float64, (n, 2, 2))
            require_within("position_covariance_m2", covariance, MAX_COVARIANCE, "m^2")
            require_covariance("position_covariance_m2", covariance)
        if self.num_points is not None:
            set_array(self, "num_points", np.int64, (n,))
        if self.velocity is not None:
            require_instance("velocity", self.velocity, VelocityMeasurement)
            if len(self.velocity) != n:
                raise InputError("length of velocity", len(self.velocity), str(n))
        object.__setattr__(self, "hull", _checked_hull(self.hull, n))

    __repr__ = Boxes.__repr__

    def _about(self) -> str:
        measured = 0 if self.velocity is None else np.count_nonzero(self.velocity.valid)
        return f"{Boxes._about(self)}, {measured} with a measured velocity"

    def with_velocity(self, velocity: VelocityMeasurement | None) -> Objects:
        """Return the same objects with these measured velocities."""
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
    """Estimates of a tracker at one stamp."""

    COLUMNS: ClassVar[Columns] = {
        **Boxes.COLUMNS,
        "id": Column(np.int64),
        "score": Column(np.float64),
        "velocity_mps": Column(np.float64, (2,)),
        "velocity_covariance_m2ps2": Column(np.float64, (2, 2)),
        "observed": Column(np.bool_),
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
    """(N,) whether an object was associated at this stamp; false while the track coasts."""
    hull: Hulls | None = None
    """For clusters: per track (K, 2) corners of the convex hull."""

    def __post_init__(self) -> None:
        Boxes.__post_init__(self)
        n = len(self)
        state = set_array(self, "state", np.float64, (n, None))
        d = state.shape[1]
        require_finite("state", state)
        require_finite("covariance", set_array(self, "covariance", np.float64, (n, d, d)))
        if not (self.id[1:] > self.id[:-1]).all():  # ascending, as ours are, none is there twice
            identities, counts = np.unique(self.id, return_counts=True)
            if len(identities) != n:
                twice = int(identities[np.argmax(counts)])
                raise InputError("id", f"{twice} for {counts.max()} tracks", "no identity twice")
        object.__setattr__(self, "hull", _checked_hull(self.hull, n))

    @classmethod
    def empty(cls, stamp_ns: int, frame: str = "world", dimensions: int = 0) -> Self:
        """Return no track, of a tracker with a state of that many dimensions."""
        state = np.zeros((0, dimensions))
        covariance = np.zeros((0, dimensions, dimensions))
        return cls(
            stamp_ns=stamp_ns, frame=frame, state=state, covariance=covariance, **cls._no_rows()
        )

    __repr__ = Boxes.__repr__

    def _about(self) -> str:
        speeds = np.hypot(self.velocity_mps[:, 0], self.velocity_mps[:, 1])
        fastest = f", up to {speeds.max():.1f} m/s" if len(self) else ""
        return f"{Boxes._about(self)}{fastest}"

    def _plan(self) -> Plan:
        """Draw the identity of each track, and its displacement of one second as a line."""
        plan = Boxes._plan(self)
        for centre, velocity, identity in zip(
            self.centre_m[:, :2], self.velocity_mps, self.id, strict=True
        ):
            plan.line(np.stack([centre, centre + velocity]), TRACK)
            plan.text(centre, str(identity), INK)
        return plan

    def _moved(self, b_T_a: Pose) -> dict[str, Any]:
        changes = Boxes._moved(self, b_T_a)
        r = rotation_2d(b_T_a.yaw_rad)
        changes["velocity_mps"] = self.velocity_mps @ r.T
        changes["velocity_covariance_m2ps2"] = r @ self.velocity_covariance_m2ps2 @ r.T
        return changes | {"hull": _moved_hull(self.hull, self.centre_m, b_T_a)}


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Truth(Boxes):
    """Annotated (or simulated) boxes at one stamp."""

    COLUMNS: ClassVar[Columns] = {
        **Boxes.COLUMNS,
        "id": Column(np.int64),
        "velocity_mps": Column(np.float64, (2,)),
        "num_points": Column(np.int64),
        "interpolated": Column(np.bool_),
    }
    MAY_BE_NAN: ClassVar[frozenset[str]] = frozenset({"velocity_mps"})

    id: I64
    """(N,) identity, unique within the scene."""
    velocity_mps: F64
    """(N, 2) velocity over the ground in the axes of ``frame``; NaN where the labels do not give
    it (a track of one box, a gap that is too long)."""
    num_points: I64
    """(N,) LiDAR returns on the object; -1 where not counted."""
    interpolated: Mask
    """(N,) whether the box was interpolated between two annotated stamps."""

    def _moved(self, b_T_a: Pose) -> dict[str, Any]:
        velocity_mps = self.velocity_mps @ rotation_2d(b_T_a.yaw_rad).T
        return Boxes._moved(self, b_T_a) | {"velocity_mps": velocity_mps}


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
    """Return whether `as_array` would change nothing; every frame carries hundreds of hulls."""
    if not isinstance(hull, np.ndarray) or hull.flags.writeable or hull.dtype != np.float64:
        return False
    return hull.ndim == 2 and hull.shape[1] == 2


def _moved_hull(hull: Hulls | None, centre_m: F64, b_T_a: Pose) -> Hulls | None:
    """Transform hulls by the pose; each hull lies at its box's height."""
    if hull is None:
        return None
    heights = centre_m[:, 2]
    return tuple(
        b_T_a.apply(np.column_stack([h, np.full(len(h), z)]))[:, :2]
        for h, z in zip(hull, heights, strict=True)
    )
