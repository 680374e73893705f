"""Points of one sweep with their true and their estimated flow, and the errors of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError

CLOSE_M = 35.0
"""Half the side of the square around the vehicle in which points are close (both challenges)."""
DYNAMIC_M = 0.05
"""Own motion within a pair from which a point is dynamic: 0.5 m/s at 10 Hz (both challenges)."""
PAIR_S = 0.1
"""Time between the sweeps of a pair that the challenges' thresholds suppose."""
STRICT, RELAXED = 0.05, 0.1
"""An error below this, in metres or as a share of the true flow, is accurate (Liu et al., 2019)."""
_ZERO = 1e-10
"""The official guard of a division by a true flow of zero."""


@dataclass(frozen=True, slots=True)
class FlowPoints:
    """N points of a sweep; flow is the displacement to the next sweep, in metres.

    Flow includes the vehicle's own motion, as in the challenge's files: what a point's coordinates
    in the vehicle's frame change by. `ego_motion_m` is that of a point at rest.
    """

    truth_m: F64
    """(N, 3)"""
    estimate_m: F64
    """(N, 3)"""
    category: I64
    """(N,) number in `CATEGORIES`; 0 is the background."""
    dynamic: Mask
    """(N,) whether the point moves over the ground."""
    dynamic_estimate: Mask
    """(N,) whether the estimate says so."""
    close: Mask
    """(N,) within `CLOSE_M` along both axes."""
    valid: Mask
    """(N,) whether the true flow is known; others do not count."""
    ego_motion_m: F64 | None = None
    """(N, 3) None where the files do not say: then nothing is known by speed."""
    xy_m: F64 | None = None
    """(N, 2) position in the vehicle's frame; None where the files do not say."""

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            column = getattr(self, name)
            if column is not None and len(column) != len(self.truth_m):
                raise InputError(f"length of {name}", len(column), f"{len(self.truth_m)}, as truth")

    def counted(self) -> FlowPoints:
        """Return the points whose true flow is known."""
        columns: dict[str, Any] = {n: getattr(self, n) for n in self.__dataclass_fields__}
        kept: dict[str, Any] = {n: c if c is None else c[self.valid] for n, c in columns.items()}
        return FlowPoints(**kept)

    @property
    def speed_m(self) -> F64:
        """(N,) true displacement over the ground; needs `ego_motion_m`."""
        if self.ego_motion_m is None:
            raise InputError("ego_motion_m", None, "the flow of points at rest")
        return np.asarray(np.linalg.norm(self.truth_m - self.ego_motion_m, axis=1))


class PointErrors(NamedTuple):
    """Errors of N points."""

    strict: F64
    """(N,) 1 where accurate to 5 cm or 5 %, else 0."""
    relaxed: F64
    """(N,) 1 where accurate to 10 cm or 10 %, else 0."""
    angle_rad: F64
    """(N,) between (flow, 0.1 s) and (true flow, 0.1 s)."""
    epe_m: F64
    """(N,) end-point error."""


def point_errors(truth_m: F64, estimate_m: F64) -> PointErrors:
    """Return the errors of (N, 3) estimates.

    EPE is |f - f_true|; a point is accurate if its EPE, or that over |f_true|, is below the
    threshold; the angle is that of the vectors in space and time, arccos of their unit product.

    >>> errors = point_errors(np.array([[1.0, 0, 0]]), np.array([[1.08, 0, 0]]))
    >>> errors.strict.tolist(), errors.relaxed.tolist(), errors.epe_m.round(6).tolist()
    ([0.0], [1.0], [0.08])
    """
    epe_m = np.linalg.norm(estimate_m - truth_m, axis=1)
    share = epe_m / (np.linalg.norm(truth_m, axis=1) + _ZERO)
    strict, relaxed = (((epe_m < t) | (share < t)).astype(np.float64) for t in (STRICT, RELAXED))
    u, v = (_direction(f) for f in (estimate_m, truth_m))
    angle_rad = np.arccos(np.clip((u * v).sum(axis=1), -1.0, 1.0))
    return PointErrors(strict, relaxed, angle_rad, epe_m)


def _direction(flow_m: F64) -> F64:
    """Return unit vectors in space and time, (N, 4)."""
    in_time = np.column_stack([flow_m, np.full(len(flow_m), PAIR_S)])
    unit: F64 = in_time / np.linalg.norm(in_time, axis=1, keepdims=True)
    return unit
