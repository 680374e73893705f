"""The outline of the vehicle that carries the LiDAR: returns inside it are of its own body.

A roof sensor sees bonnet, roof and mirrors in every sweep. Motion compensation moves these returns,
which travel with the vehicle, backwards by up to its way in a revolution; without a cut they are an
object beside which the vehicle never gains a metre, tracked at the vehicle's own speed.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core import Sweep


class VehicleOutline(StrictModel):
    """A rectangle over the ground in the ego frame, mirrors and the reach of the smear included."""

    front_m: float = Field(gt=0, le=20, description="from the origin of the ego frame forwards")
    rear_m: float = Field(gt=0, le=20, description="from there backwards")
    side_m: float = Field(gt=0, le=5, description="from there to either side")

    def cut(self, sweep: Sweep) -> Sweep:
        """Return the sweep without the points above or below the outline, at any height."""
        x, y = sweep.xyz_m[:, 0], sweep.xyz_m[:, 1]
        own = (x < self.front_m) & (x > -self.rear_m) & (np.abs(y) < self.side_m)
        return sweep.select(~own) if own.any() else sweep


def without_own_body(sweep: Sweep, outline: VehicleOutline | None) -> Sweep:
    """Return the sweep without returns of the vehicle itself; unchanged without an outline."""
    return sweep if outline is None else outline.cut(sweep)
