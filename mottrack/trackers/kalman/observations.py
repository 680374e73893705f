"""What is observed in one step, as the kernels read it; rows are found by `Matched`."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64


class Matched(NamedTuple):
    """n tracks and the detections that they were matched with."""

    rows: I64
    """(n,) of the tracks."""
    columns: I64
    """(n,) of the detections."""

    def select(self, index: NDArray[Any]) -> Matched:
        """Return the pairs that a mask or an index picks."""
        return Matched(self.rows[index], self.columns[index])


class Observation(NamedTuple):
    """M measured vectors in the plane."""

    value: F64
    """(M, 2 or more): of boxes (M, 7) the first two numbers count."""
    covariance: F64
    """(M, 2, 2)"""


class SeenBoxes(NamedTuple):
    """M detected boxes."""

    box: F64
    """(M, 7) x, y, z, yaw, l, w, h."""
    xy_covariance: F64
    """(M, 2, 2) covariance of x, y."""
    z_yaw_size_variance: F64
    """(M, 5) variances of z, yaw, l, w, h."""
