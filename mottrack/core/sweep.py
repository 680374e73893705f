"""One turn of the LiDAR."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F32, F64, I16, I64
from mottrack.core.checks import as_array, as_stamp, require_finite, require_instance
from mottrack.core.errors import InputError
from mottrack.core.pose import Pose


@dataclass(frozen=True, slots=True)
class Sweep:
    """The points of one turn of the LiDAR, in the ego frame at ``stamp_ns``.

    The ego frame has x forward, y left, z up; its origin's height over the road differs from one
    data set to the next.

    Arrays are not copied: whoever fills a buffer again with the next turn hands over a copy.

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
    """Where the vehicle stood at ``stamp_ns``."""
    origin_m: F64 = field(default_factory=lambda: np.zeros(3))
    """(3,) optical centre of the sensor in the ego frame: where the rays start."""
    time_offset_ns: I64 | None = None
    """(N,) when each point was measured, relative to ``stamp_ns``; None where not recorded."""
    ring: I16 | None = None
    """(N,) index of the beam; None where not recorded."""

    def __post_init__(self) -> None:
        xyz_m = as_array("xyz_m", self.xyz_m, np.float32, (None, 3))
        n = len(xyz_m)
        reflectance = as_array("reflectance", self.reflectance, np.float32, (n,))
        origin_m = as_array("origin_m", self.origin_m, np.float64, (3,))
        require_instance("world_T_ego", self.world_T_ego, Pose)
        require_finite("xyz_m", xyz_m)
        require_finite("reflectance", reflectance)
        require_finite("origin_m", origin_m)
        if n and not (reflectance.min() >= 0.0 and reflectance.max() <= 1.0):
            span = [float(reflectance.min()), float(reflectance.max())]
            raise InputError("range of reflectance", span, "within [0, 1]")
        object.__setattr__(self, "xyz_m", xyz_m)
        object.__setattr__(self, "reflectance", reflectance)
        object.__setattr__(self, "origin_m", origin_m)
        object.__setattr__(self, "stamp_ns", as_stamp("stamp_ns", self.stamp_ns))
        self._check_optional("time_offset_ns", np.int64)
        self._check_optional("ring", np.int16)

    def _check_optional(self, name: str, dtype: type[np.generic]) -> None:
        value = getattr(self, name)
        if value is not None:
            object.__setattr__(self, name, as_array(name, value, dtype, (len(self.xyz_m),)))

    def __len__(self) -> int:
        return len(self.xyz_m)

    def select(self, index: NDArray[Any]) -> Sweep:
        """The points that a boolean mask or an integer index picks."""
        return Sweep(
            xyz_m=self.xyz_m[index],
            reflectance=self.reflectance[index],
            stamp_ns=self.stamp_ns,
            world_T_ego=self.world_T_ego,
            origin_m=self.origin_m,
            time_offset_ns=None if self.time_offset_ns is None else self.time_offset_ns[index],
            ring=None if self.ring is None else self.ring[index],
        )

    def seen_from(self, other: Sweep) -> Sweep:
        """The same points in the ego frame of ``other``: ego motion removed, time kept.

        ``world_T_ego`` becomes that of ``other``; the optical centre moves along, so a ray still
        starts where the sensor stood.
        """
        other_T_self = other.world_T_ego.inverse() @ self.world_T_ego
        return Sweep(
            xyz_m=other_T_self.apply(self.xyz_m).astype(np.float32),
            reflectance=self.reflectance,
            stamp_ns=self.stamp_ns,
            world_T_ego=other.world_T_ego,
            origin_m=other_T_self.apply(self.origin_m[None])[0],
            time_offset_ns=self.time_offset_ns,
            ring=self.ring,
        )


def seconds_between(earlier_ns: int, later_ns: int) -> float:
    """Elapsed time in seconds: the one place where nanoseconds become seconds."""
    return (later_ns - earlier_ns) * 1e-9
