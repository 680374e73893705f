"""Puts the bodies of the movers where they are at one time."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64
from mottrack.world.bodies import Troupe
from mottrack.world.solids import Solids
from mottrack.world.states import States


def stage(troupe: Troupe, states: States, floor_m: F64) -> Solids:
    """The movers' solids in the world, with the motion that the scan needs.

    Args:
        troupe: bodies of N movers.
        states: the N movers at the stamp.
        floor_m: (N,) height of each mover's underside in the world.
    """
    local, who = troupe.solids, troupe.solids.owner
    swing, swing_rate = _swing(troupe, states)
    x, y = local.centre_m[:, 0] + swing, local.centre_m[:, 1]
    c, s = np.cos(states.yaw_rad)[who], np.sin(states.yaw_rad)[who]
    arm = np.column_stack([c * x - s * y, s * x + c * y])
    rate = states.yaw_rate_radps[who]
    centre = np.column_stack([states.xy_m[who] + arm, floor_m[who] + local.centre_m[:, 2]])
    velocity = states.velocity_mps[who].copy()
    velocity[:, 0] += -rate * arm[:, 1] + swing_rate * c
    velocity[:, 1] += rate * arm[:, 0] + swing_rate * s
    acceleration = states.acceleration_mps2[who].copy()
    acceleration[:, :2] -= (rate**2)[:, None] * arm
    return local._replace(
        centre_m=centre,
        yaw_rad=states.yaw_rad[who] + local.yaw_rad,
        velocity_mps=velocity,
        acceleration_mps2=acceleration,
        yaw_rate_radps=rate,
    )


def _swing(troupe: Troupe, states: States) -> tuple[F64, F64]:
    """(P,) forward shift of swinging parts and its rate of change."""
    who = troupe.solids.owner
    wave = np.where(troupe.stride_m > 0, 2.0 * np.pi / np.maximum(troupe.stride_m, 0.1), 0.0)
    angle = wave * states.way_m[who]
    speed = np.hypot(states.velocity_mps[:, 0], states.velocity_mps[:, 1])[who]
    return troupe.swing_m * np.sin(angle), troupe.swing_m * wave * speed * np.cos(angle)
