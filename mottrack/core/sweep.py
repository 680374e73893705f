"""LiDAR sweeps and their times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F32, F64, I16, I64
from mottrack.core.checks import (
    MAX_PLACE_M,
    require_finite,
    require_instance,
    require_within,
    set_array,
    set_stamp,
)
from mottrack.core.errors import InputError
from mottrack.core.pose import Pose


@dataclass(frozen=True, slots=True)
class Sweep:
    """The points of one LiDAR revolution, in the ego frame at ``stamp_ns``.

    The ego frame has x forward, y left, z up; its origin's height over the road differs from one
    data set to the next.

    Arrays are not copied: a driver that reuses its buffer for the next sweep hands over a copy.

    Raises:
        InputError: a shape is wrong, a number is not finite, reflectance outside [0, 1], or the
            pose is no `Pose`.
    """

    xyz_m: F32
    """(N, 3) points in metres, ego frame."""
    reflectance: F32
    """(N,) reflected intensity in [0, 1]."""
    stamp_ns: int
    """Time to which the points are motion-compensated."""
    world_T_ego: Pose
    """Pose of the vehicle at ``stamp_ns``."""
    origin_m: F64 = field(default_factory=lambda: np.zeros(3))
    """(3,) optical centre of the sensor in the ego frame: where the rays start."""
    time_offset_ns: I64 | None = None
    """(N,) when each point was measured, relative to ``stamp_ns``; None where not recorded."""
    ring: I16 | None = None
    """(N,) index of the beam; None where not recorded."""

    def __post_init__(self) -> None:
        xyz_m = set_array(self, "xyz_m", np.float32, (None, 3))
        n = len(xyz_m)
        reflectance = set_array(self, "reflectance", np.float32, (n,))
        origin_m = set_array(self, "origin_m", np.float64, (3,))
        require_instance("world_T_ego", self.world_T_ego, Pose)
        require_within("xyz_m", xyz_m, MAX_PLACE_M, "m")
        require_within(
            "world_T_ego.translation_m", self.world_T_ego.translation_m, MAX_PLACE_M, "m"
        )
        require_finite("reflectance", reflectance)
        require_within("origin_m", origin_m, MAX_PLACE_M, "m")
        if n and not (reflectance.min() >= 0.0 and reflectance.max() <= 1.0):
            span = [float(reflectance.min()), float(reflectance.max())]
            raise InputError("range of reflectance", span, "within [0, 1]")
        set_stamp(self)
        if self.time_offset_ns is not None:
            set_array(self, "time_offset_ns", np.int64, (n,))
        if self.ring is not None:
            set_array(self, "ring", np.int16, (n,))

    def __len__(self) -> int:
        return len(self.xyz_m)

    def select(self, index: NDArray[Any]) -> Sweep:
        """Return the points that a boolean mask or an integer index picks."""
        if index.dtype == np.bool_:
            index = np.flatnonzero(index)
        offset_ns, ring = self.time_offset_ns, self.ring
        return replace(
            self,
            xyz_m=self.xyz_m.take(index, axis=0),  # several times as fast as by brackets
            reflectance=self.reflectance.take(index),
            time_offset_ns=None if offset_ns is None else offset_ns.take(index),
            ring=None if ring is None else ring.take(index),
        )

    @classmethod
    def lost(cls, stamp_ns: int, world_T_ego: Pose) -> Sweep:
        """Return a sweep without points: one that was not recorded, or did not arrive."""
        return cls(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), stamp_ns, world_T_ego)

    def seen_from(self, other: Sweep) -> Sweep:
        """Return the same points in the ego frame of ``other``: ego motion removed, time kept.

        ``world_T_ego`` becomes that of ``other``; the optical centre moves with the points, so the
        rays still start at the sensor.
        """
        other_T_self = other.world_T_ego.inverse() @ self.world_T_ego
        return replace(
            self,
            xyz_m=other_T_self.apply(self.xyz_m).astype(np.float32),
            world_T_ego=other.world_T_ego,
            origin_m=other_T_self.apply(self.origin_m[None])[0],
        )


SECOND_NS = 1_000_000_000
FASTEST_EGO_MPS = 80.0
"""290 km/h: a vehicle that was faster between two sweeps has not moved, its pose has jumped."""
FASTEST_TURN_RADPS = 10.0
"""More than a turn and a half a second: faster than any vehicle spins, and than a hand turns."""
JUMP_SLACK_M, JUMP_SLACK_RAD = 1.0, 0.2
"""Steps of a localisation that corrects itself are smaller; sweeps of two sensors may be a
millisecond apart, in which any of them would be too fast."""


@overload
def seconds_between(earlier_ns: int, later_ns: int) -> float: ...
@overload
def seconds_between(earlier_ns: I64, later_ns: I64 | int) -> F64: ...
@overload
def seconds_between(earlier_ns: int, later_ns: I64) -> F64: ...
def seconds_between(earlier_ns: Any, later_ns: Any) -> Any:
    """Return the elapsed time in seconds between stamps in nanoseconds, or arrays of them."""
    return (later_ns - earlier_ns) * 1e-9


def has_jumped(previous: Sweep, current: Sweep) -> bool:
    """Return whether the pose moved or turned farther than any vehicle does in the elapsed time.

    Of such a pair the ego motion is not known, so that no velocity can be measured from it.
    """
    elapsed_s = max(seconds_between(previous.stamp_ns, current.stamp_ns), 0.0)
    before, now = previous.world_T_ego, current.world_T_ego
    moved_m = float(np.linalg.norm(now.translation_m - before.translation_m))
    # the trace of a rotation by an angle is 1 + 2 cos(angle)
    cosine = 0.5 * (float(np.einsum("ij,ij->", before.rotation, now.rotation)) - 1.0)
    turned_rad = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return (
        moved_m > FASTEST_EGO_MPS * elapsed_s + JUMP_SLACK_M
        or turned_rad > FASTEST_TURN_RADPS * elapsed_s + JUMP_SLACK_RAD
    )


def median_period_s(stamps_ns: Sequence[int] | I64, default_s: float) -> float:
    """Return the median time between consecutive stamps; ``default_s`` for fewer than two."""
    if len(stamps_ns) < 2:
        return default_s
    return float(np.median(np.diff(stamps_ns))) / SECOND_NS
