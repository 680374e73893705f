"""What association reads of the tracks, carried to the time of the detections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64


@dataclass(frozen=True, slots=True)
class Predicted:
    """What association reads of N predicted tracks."""

    mean: F64
    """(N, D) states."""
    planar: F64
    """(N, 4, 4) covariance of (x, y, d_x, d_y)."""
    axial: F64
    """(N, 5) variances of z, yaw, l, w, h."""
    label: I64
    """(N,) index of the class."""

    def select(self, index: NDArray[Any]) -> Predicted:
        """The rows that a mask or an index picks."""
        return Predicted(*(getattr(self, name)[index] for name in self.__slots__))
