"""States of all agents at any time, and their bodies as solids in the world."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64
from mottrack.world.bodies import Bodies
from mottrack.world.curves import Paths, sample_smooth
from mottrack.world.driving import STEP_S, Motion
from mottrack.world.solids import Solids
from mottrack.world.traffic import Agents, Traffic


class States(NamedTuple):
    """N agents at one time, world frame."""

    xy_m: F64
    """(N, 2) middle of the footprint."""
    lift_m: F64
    """(N,) height of the underside over the ground."""
    yaw_rad: F64
    velocity_mps: F64
    """(N, 3)"""
    acceleration_mps2: F64
    """(N, 3)"""
    yaw_rate_radps: F64
    travelled_m: F64
    """(N,) distance travelled, which sets the phase of legs."""


class _Progress(NamedTuple):
    """Motion of N agents along their paths, arrays (N,)."""

    s_m: F64
    speed_mps: F64
    acceleration_mps2: F64


def join(parts: list[States]) -> States:
    """Return the agents of all parts, in that order."""
    return States(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def resting(xy_m: F64, yaw_rad: F64) -> States:
    """Return the states of agents that stand still on the ground."""
    n = len(xy_m)
    none, nothing = np.zeros((n, 3)), np.zeros(n)
    return States(xy_m, nothing, yaw_rad, none, none, nothing, nothing)


def traffic_states(traffic: Traffic, motion: Motion, since_s: float) -> States:
    """Return the states of a Traffic ``since_s`` after the first step of its motion."""
    step = min(max(int(since_s / STEP_S), 0), len(motion.s_m) - 1)
    tau = since_s - step * STEP_S
    v0, a = motion.speed_mps[step], motion.acceleration_mps2[step]
    s = motion.s_m[step] + v0 * tau + 0.5 * a * tau * tau
    speed = np.maximum(v0 + a * tau, 0.0)
    table = _follow_paths(traffic.paths, traffic.agents, _Progress(s, speed, a))
    none = np.zeros(len(s))
    return States(
        xy_m=table[:, 0:2],
        lift_m=none,
        yaw_rad=table[:, 2],
        velocity_mps=np.column_stack([table[:, 3:5], none]),
        acceleration_mps2=np.column_stack([table[:, 5:7], none]),
        yaw_rate_radps=table[:, 7],
        travelled_m=s,
    )


@compiled
def _follow_paths(paths: Paths, agents: Agents, progress: _Progress) -> F64:
    """Return (N, 8) x, y, yaw, vx, vy, ax, ay, yaw rate of agents whose rear axle follows a path.

    The middle of an agent lies half a wheelbase ahead of the axle, which runs beside the path by
    its lateral place and its sway.
    """
    out = np.empty((len(agents.path), 8))
    for i in range(len(out)):
        s, v, a = progress.s_m[i], progress.speed_mps[i], progress.acceleration_mps2[i]
        x, y, dx, dy, ddx, ddy = sample_smooth(paths, agents.path[i], s)
        pace = np.hypot(dx, dy)
        bend = (dx * ddy - dy * ddx) / pace**2
        ahead, amplitude = 0.5 * agents.wheelbase_m[i], agents.sway_amplitude_m[i]
        wave = 2.0 * np.pi / max(agents.sway_wave_m[i], 1.0)
        angle = wave * s + agents.sway_phase_rad[i]
        left = agents.lateral_m[i] + amplitude * np.sin(angle)
        along, across = pace - left * bend, amplitude * wave * np.cos(angle)
        heading, slant = np.arctan2(dy, dx), np.arctan2(across, along)
        bend = bend - amplitude * wave * wave * np.sin(angle)
        yaw, speed, yaw_rate = heading + slant, v * np.hypot(along, across), v * bend
        cos, sin = np.cos(yaw), np.sin(yaw)
        out[i, 0] = x - left * np.sin(heading) + ahead * cos
        out[i, 1] = y + left * np.cos(heading) + ahead * sin
        out[i, 2], out[i, 7] = yaw, yaw_rate
        out[i, 3] = speed * cos - ahead * yaw_rate * sin
        out[i, 4] = speed * sin + ahead * yaw_rate * cos
        forward, aside = a - ahead * yaw_rate * yaw_rate, v * yaw_rate + ahead * a * bend
        out[i, 5], out[i, 6] = forward * cos - aside * sin, forward * sin + aside * cos
    return out


def place_bodies(bodies: Bodies, states: States, floor_m: F64) -> Solids:
    """Return the agents' solids in the world, with the motion that the scan needs.

    Args:
        bodies: of N agents.
        states: of the N agents at the stamp.
        floor_m: (N,) height of each agent's underside in the world.
    """
    local, row = bodies.solids, bodies.solids.owner
    # forward shift of swinging parts and its rate of change; strides are 0 or a step's length
    wave = np.where(bodies.stride_m > 0, 2.0 * np.pi / np.maximum(bodies.stride_m, 0.1), 0.0)
    angle = wave * states.travelled_m[row]
    speed = np.hypot(states.velocity_mps[:, 0], states.velocity_mps[:, 1])[row]
    swing, swing_rate = (
        bodies.swing_m * np.sin(angle),
        bodies.swing_m * wave * speed * np.cos(angle),
    )
    x, y = local.centre_m[:, 0] + swing, local.centre_m[:, 1]
    c, s = np.cos(states.yaw_rad)[row], np.sin(states.yaw_rad)[row]
    arm = np.column_stack([c * x - s * y, s * x + c * y])
    rate = states.yaw_rate_radps[row]
    centre = np.column_stack([states.xy_m[row] + arm, floor_m[row] + local.centre_m[:, 2]])
    velocity = states.velocity_mps[row].copy()
    velocity[:, 0] += -rate * arm[:, 1] + swing_rate * c
    velocity[:, 1] += rate * arm[:, 0] + swing_rate * s
    acceleration = states.acceleration_mps2[row].copy()
    acceleration[:, :2] -= (rate**2)[:, None] * arm
    return local._replace(
        centre_m=centre,
        yaw_rad=states.yaw_rad[row] + local.yaw_rad,
        velocity_mps=velocity,
        acceleration_mps2=acceleration,
        yaw_rate_radps=rate,
    )
