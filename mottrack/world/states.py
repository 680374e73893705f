"""Where every mover is at any time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64
from mottrack.world.curves import Paths, sample_smooth
from mottrack.world.driving import STEP_S, Motion
from mottrack.world.traffic import Traffic


class States(NamedTuple):
    """N movers at one time, world frame; ``xy_m`` is the middle of the footprint."""

    xy_m: F64
    lift_m: F64
    """(N,) height of the underside over the ground."""
    yaw_rad: F64
    velocity_mps: F64
    """(N, 3)"""
    acceleration_mps2: F64
    """(N, 3)"""
    yaw_rate_radps: F64
    way_m: F64
    """(N,) way gone, which sets the phase of legs."""


def join(first: States, second: States) -> States:
    """The movers of both, in that order."""
    return States(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def resting(xy_m: F64, yaw_rad: F64) -> States:
    """Movers that stand still on the ground."""
    n = len(xy_m)
    none, nothing = np.zeros((n, 3)), np.zeros(n)
    return States(xy_m, nothing, yaw_rad, none, none, nothing, nothing)


def traffic_states(traffic: Traffic, motion: Motion, since_s: float) -> States:
    """The movers of a Traffic ``since_s`` after the first step of its motion."""
    step = min(max(int(since_s / STEP_S), 0), len(motion.s_m) - 1)
    tau = since_s - step * STEP_S
    v0, a = motion.speed_mps[step], motion.acceleration_mps2[step]
    s = motion.s_m[step] + v0 * tau + 0.5 * a * tau * tau
    speed = np.maximum(v0 + a * tau, 0.0)
    table = _bodies(traffic.paths, traffic.path, (s, speed, a), _habits(traffic))
    return States(
        xy_m=table[:, 0:2],
        lift_m=np.zeros(len(s)),
        yaw_rad=table[:, 2],
        velocity_mps=np.column_stack([table[:, 3:5], np.zeros(len(s))]),
        acceleration_mps2=np.column_stack([table[:, 5:7], np.zeros(len(s))]),
        yaw_rate_radps=table[:, 7],
        way_m=s,
    )


def _habits(traffic: Traffic) -> F64:
    """(N, 5): middle ahead of the axle, lateral place, sway amplitude, wave number, phase."""
    sway = traffic.sway
    wave = 2.0 * np.pi / np.maximum(sway[:, 1], 1.0)
    return np.column_stack(
        [0.5 * traffic.driver[:, 4], traffic.lateral_m, sway[:, 0], wave, sway[:, 2]]
    )


@compiled
def _bodies(
    paths: Paths,
    path: I64,
    progress: tuple[F64, F64, F64],
    habits: F64,
) -> F64:
    """(N, 8): x, y, yaw, vx, vy, ax, ay, yaw rate of bodies whose rear axle follows a path."""
    way, pace, push = progress
    out = np.empty((len(path), 8))
    for i in range(len(path)):
        x, y, dx, dy, ddx, ddy = sample_smooth(paths, path[i], way[i])
        pace_of_path = np.hypot(dx, dy)
        bend = (dx * ddy - dy * ddx) / pace_of_path**2
        ahead, lateral, amplitude, wave, phase = habits[i]
        angle = wave * way[i] + phase
        left = lateral + amplitude * np.sin(angle)
        along, across = pace_of_path - left * bend, amplitude * wave * np.cos(angle)
        heading, slant = np.arctan2(dy, dx), np.arctan2(across, along)
        bend = bend - amplitude * wave * wave * np.sin(angle)
        v, a, turn = pace[i], push[i], pace[i] * bend
        yaw, speed = heading + slant, v * np.hypot(along, across)
        c, s = np.cos(yaw), np.sin(yaw)
        out[i, 0] = x - left * np.sin(heading) + ahead * c
        out[i, 1] = y + left * np.cos(heading) + ahead * s
        out[i, 2], out[i, 7] = yaw, turn
        out[i, 3], out[i, 4] = speed * c - ahead * turn * s, speed * s + ahead * turn * c
        forward, aside = a - ahead * turn * turn, v * turn + ahead * a * bend
        out[i, 5], out[i, 6] = forward * c - aside * s, forward * s + aside * c
    return out
