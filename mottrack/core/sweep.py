"""LiDAR sweeps and their times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F32, F64, I16, I64
from mottrack.core.checks import require_finite, require_instance, set_array, set_stamp
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
        require_finite("xyz_m", xyz_m)
        require_finite("reflectance", reflectance)
        require_finite("origin_m", origin_m)
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
        return replace(
            self,
            xyz_m=self.xyz_m[index],
            reflectance=self.reflectance[index],
            time_offset_ns=None if self.time_offset_ns is None else self.time_offset_ns[index],
            ring=None if self.ring is None else self.ring[index],
        )

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


@overload
def seconds_between(earlier_ns: int, later_ns: int) -> float: ...
@overload
def seconds_between(earlier_ns: I64, later_ns: I64 | int) -> F64: ...
@overload
def seconds_between(earlier_ns: int, later_ns: I64) -> F64: ...
def seconds_between(earlier_ns: Any, later_ns: Any) -> Any:
    """Return the elapsed time in seconds between stamps in nanoseconds, or arrays of them."""
    return (later_ns - earlier_ns) * 1e-9


def median_period_s(stamps_ns: Sequence[int] | I64, default_s: float) -> float:
    """Return the median time between consecutive stamps; ``default_s`` for fewer than two."""
    if len(stamps_ns) < 2:
        return default_s
    return float(np.median(np.diff(stamps_ns))) / SECOND_NS
