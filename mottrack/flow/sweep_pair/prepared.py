"""Two sweeps made ready for a flow estimator."""

from __future__ import annotations

from dataclasses import dataclass

from mottrack.core.arrays import F32, I8
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.flow.sweep_pair.sweep_work import SweepFeatures


@dataclass(frozen=True, slots=True)
class SweepPair:
    """A pair of sweeps made ready for an estimator; everything is in the CURRENT ego frame."""

    previous: Sweep
    """Kept points of the previous sweep; ego motion (and its residual, if aligned) removed."""
    current: Sweep
    """Kept points of the current sweep."""
    previous_work: SweepFeatures
    """Of all points of the previous sweep, in ITS ego frame."""
    current_work: SweepFeatures
    """Of all points of the current sweep."""
    previous_T_current: Pose
    """From the current ego frame to the previous sweep's own, the correction included."""
    previous_height_m: F32
    """(N_previous,) height of each kept point above the ground."""
    current_height_m: F32
    """(N_current,) height of each kept point above the ground."""
    elapsed_s: float
    """Time between the two stamps."""
    correction: Pose
    """`aligned_T_compensated`: what alignment added to the odometry; the identity if off."""
    previous_seen: I8 | None
    """(H, W) UNSEEN, FREE or OCCUPIED in the previous sweep; None if the stage is off."""
    current_seen: I8 | None
    """(H, W) the same of the current sweep."""
