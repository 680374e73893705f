"""Driving: car following, traffic lights, and right of way by what is in the path.

Acceleration is that of the Intelligent Driver Model (Treiber, Hennecke and Helbing, Phys. Rev. E
62, 2000), towards the nearest agent in the own path or the stop line of a red light, at most at
the speed that the next bend allows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64
from mottrack.world.curves import Paths, sample
from mottrack.world.roads import NO_SIGNAL
from mottrack.world.traffic import Agents, Traffic

STEP_S = 0.1
_FAR_M = 1e6  # A gap beyond it is none
# braking: comfortably into bends and for lights, hard in an emergency (dry asphalt allows 8 m/s^2)
_BEND_BRAKING_MPS2, _LIGHT_BRAKING_MPS2, _HARDEST_MPS2 = 1.2, 3.5, 6.0
_STANDING_BRAKING_MPS2 = 1.0
_LATERAL_MPS2 = 2.2  # In bends: what passengers find comfortable
_STRAIGHT_PER_M = 1e-4  # Least curvature that limits the speed, to 148 m/s: that is, none
_BEND_NEAR_M, _BEND_STEP_M = 6.0, 3.0
_LEAST_DESIRED_MPS = 0.3
# how far ahead is looked: 3.2 s and the length of two cars
_LOOK_NEAR_M, _LOOK_S, _LOOK_FAR_M = 12.0, 3.2, 90.0
_LOOK_START_M, _LOOK_STEP_M = 0.2, 1.5
_VEHICLE_SIDE_M = 0.25
"""Passing distance that vehicles keep besides half their width; those on foot pass closer."""
_OVER_LINE_M = 0.5  # Further over the stop line an agent drives on
_KERB_M, _KERB_GAP_M = 0.8, 0.05
"""Pedestrians who have gone no further than this onto a crossing wait for green."""


class Signals(NamedTuple):
    """Cyclic plan of the lights: one approach after the other, then all crossings."""

    green_s: F64
    """(A + 1,) green of each approach, then of the crossings."""
    clear_s: float
    """All red after each green."""
    shift_s: float
    """Time of the plan at time 0."""


class Motion(NamedTuple):
    """T steps of N agents, STEP_S apart; within a step the acceleration is constant."""

    s_m: F64
    """(T, N) arc length of the rear axle (of the middle where there are no axles)."""
    speed_mps: F64
    acceleration_mps2: F64


class _Boxes(NamedTuple):
    """Footprints of N agents at one time, arrays (N,)."""

    x_m: F64
    y_m: F64
    heading_rad: F64
    half_length_m: F64
    half_width_m: F64
    speed_mps: F64


class _Leader(NamedTuple):
    """What is ahead of an agent."""

    gap_m: float
    """inf if the path is clear."""
    speed_mps: float
    """Along the path."""


class _State(NamedTuple):
    """One agent at one time."""

    s_m: float
    speed_mps: float
    red: bool
    """Whether its light is red."""


class _View(NamedTuple):
    """Where an agent looks along its path."""

    agent: int
    front_m: float
    """Arc length of its front."""
    reach_m: float
    side_m: float
    """Half the width that it needs."""


def random_signals(rng: np.random.Generator, approaches: int) -> Signals:
    """Draw a plan for that many approaches.

    The first, on which the ego vehicle comes, gets most of the green, and gets it near the
    beginning more often than not: scenes are shorter than a cycle of lights. The numbers are
    chosen by eye for that.
    """
    green = np.append(rng.uniform(4.0, 7.0, approaches), 8.0)
    green[0] = rng.uniform(10.0, 20.0)
    shift = -rng.uniform(-6.0, 9.0) if rng.random() < 0.65 else rng.uniform(0.0, 60.0)
    return Signals(green, 2.0, float(shift))


@compiled
def _is_green(signals: Signals, approach: int, time_s: float) -> bool:
    cycle = signals.green_s.sum() + len(signals.green_s) * signals.clear_s
    clock = (time_s + signals.shift_s) % cycle
    for phase in range(len(signals.green_s)):
        if clock < signals.green_s[phase]:
            return phase == approach
        clock -= signals.green_s[phase] + signals.clear_s
        if clock < 0.0:
            return False
    return False


def simulate(traffic: Traffic, signals: Signals, begin_s: float, end_s: float) -> Motion:
    """Move all agents from a first to a last time in steps of STEP_S."""
    shape = (round((end_s - begin_s) / STEP_S) + 1, len(traffic.label))
    motion = Motion(np.empty(shape), np.empty(shape), np.zeros(shape))
    motion.s_m[0], motion.speed_mps[0] = traffic.start_m, traffic.speed_mps
    _simulate(traffic.agents, traffic.paths, signals, motion, begin_s)
    return motion


@compiled
def _simulate(
    agents: Agents, paths: Paths, signals: Signals, motion: Motion, begin_s: float
) -> None:
    steps, n = motion.s_m.shape
    half_length, half_width = 0.5 * agents.size_m[:, 0], 0.5 * agents.size_m[:, 1]
    x, y, heading = np.empty(n), np.empty(n), np.empty(n)
    for k in range(steps):
        s, v, a = motion.s_m[k], motion.speed_mps[k], motion.acceleration_mps2[k]
        boxes = _Boxes(x, y, heading, half_length, half_width, v)
        _place(agents, paths, s, boxes)
        for i in range(n):
            if agents.towed_by[i] >= 0:
                a[i] = a[agents.towed_by[i]]
                continue
            green = _is_green(signals, agents.approach[i], begin_s + k * STEP_S)
            red = agents.approach[i] != NO_SIGNAL and not green
            wanted = _acceleration(agents, paths, boxes, i, _State(s[i], v[i], red))
            a[i] = max(wanted, -v[i] / STEP_S)
        if k + 1 < steps:
            for i in range(n):
                motion.s_m[k + 1, i] = s[i] + v[i] * STEP_S + 0.5 * a[i] * STEP_S * STEP_S
                motion.speed_mps[k + 1, i] = max(v[i] + a[i] * STEP_S, 0.0)


@compiled
def _place(agents: Agents, paths: Paths, s: F64, boxes: _Boxes) -> None:
    """Fill in where the agents are."""
    for i in range(len(s)):
        x, y, heading, _ = sample(paths, agents.path[i], s[i])
        ahead, left = 0.5 * agents.wheelbase_m[i], agents.lateral_m[i]
        boxes.x_m[i] = x + ahead * np.cos(heading) - left * np.sin(heading)
        boxes.y_m[i] = y + ahead * np.sin(heading) + left * np.cos(heading)
        boxes.heading_rad[i] = heading


@compiled
def _acceleration(agents: Agents, paths: Paths, boxes: _Boxes, i: int, state: _State) -> float:
    s, v, red = state
    if agents.desired_mps[i] <= 0.0:
        return -min(v / STEP_S, _STANDING_BRAKING_MPS2)
    front = s + 0.5 * (agents.wheelbase_m[i] + agents.size_m[i, 0])
    look = min(_LOOK_NEAR_M + _LOOK_S * v, _LOOK_FAR_M)
    desired = _bend_speed(paths, agents.path[i], s, v, agents.desired_mps[i])
    side = boxes.half_width_m[i]
    side = 0.5 * side if agents.wheelbase_m[i] <= 0.0 else side + _VEHICLE_SIDE_M
    leader = _leader(agents, paths, boxes, _View(i, front, look, side))
    to_line = agents.stop_m[i] - front
    can_stop = v * v < 2.0 * _LIGHT_BRAKING_MPS2 * max(to_line, 0.01)
    if red and -_OVER_LINE_M < to_line < leader.gap_m and can_stop:
        leader = _Leader(to_line, 0.0)
    if red and np.isinf(agents.stop_m[i]) and s < _KERB_M:
        leader = _Leader(min(leader.gap_m, _KERB_GAP_M), 0.0)
    return _follow(agents, i, v, max(desired, _LEAST_DESIRED_MPS), leader)


@compiled
def _follow(agents: Agents, i: int, v: float, desired: float, leader: _Leader) -> float:
    """Return the IDM's acceleration, eq. (2) and (3) of the paper: a [1 - (v/v0)^4 - (s*/s)^2]."""
    a, b = agents.acceleration_mps2[i], agents.braking_mps2[i]
    dynamic = v * agents.headway_s[i] + v * (v - leader.speed_mps) / (2.0 * np.sqrt(a * b))
    wanted = agents.gap_m[i] + max(dynamic, 0.0)
    free = 1.0 - min(v / desired, 2.0) ** 4
    brake = (wanted / max(leader.gap_m, 0.1)) ** 2 if leader.gap_m < _FAR_M else 0.0
    return float(max(a * (free - brake), -_HARDEST_MPS2))


@compiled
def _bend_speed(paths: Paths, path: int, s: float, v: float, desired: float) -> float:
    """Return the desired speed, lowered so that bends within braking distance are taken gently."""
    ahead, reach = 0.0, _BEND_NEAR_M + v * v / 3.0
    while ahead < reach:
        curvature = abs(sample(paths, path, s + ahead).curvature_per_m)
        bend = np.sqrt(_LATERAL_MPS2 / max(curvature, _STRAIGHT_PER_M))
        desired = min(desired, np.sqrt(bend * bend + 2.0 * _BEND_BRAKING_MPS2 * ahead))
        ahead += _BEND_STEP_M
    return desired


@compiled
def _leader(agents: Agents, paths: Paths, boxes: _Boxes, view: _View) -> _Leader:
    """Return the nearest agent in the path of another."""
    i, look, leader = view.agent, view.reach_m, _Leader(np.inf, 0.0)
    c, s = np.cos(boxes.heading_rad[i]), np.sin(boxes.heading_rad[i])
    for j in range(len(boxes.x_m)):
        dx, dy = boxes.x_m[j] - boxes.x_m[i], boxes.y_m[j] - boxes.y_m[i]
        reach = look + boxes.half_length_m[j] + boxes.half_length_m[i]
        if (
            i == j
            or agents.towed_by[j] == i
            or dx * dx + dy * dy > reach * reach
            or dx * c + dy * s < -0.5 * look
        ):
            continue
        nearer = _View(i, view.front_m, min(look, leader.gap_m), view.side_m)
        gap, heading = _first_inside(paths, agents, boxes, j, nearer)
        if gap < leader.gap_m:
            along = boxes.speed_mps[j] * np.cos(boxes.heading_rad[j] - heading)
            leader = _Leader(gap, max(along, 0.0))
    return leader


@compiled
def _first_inside(
    paths: Paths, agents: Agents, boxes: _Boxes, j: int, view: _View
) -> tuple[float, float]:
    """Return (distance until the own path enters box j, heading there); inf if it does not."""
    path, left = agents.path[view.agent], agents.lateral_m[view.agent]
    c, s = np.cos(boxes.heading_rad[j]), np.sin(boxes.heading_rad[j])
    ahead = _LOOK_START_M
    while ahead < view.reach_m:
        x, y, heading, _ = sample(paths, path, view.front_m + ahead)
        dx = x - left * np.sin(heading) - boxes.x_m[j]
        dy = y + left * np.cos(heading) - boxes.y_m[j]
        across = abs(c * dy - s * dx) - boxes.half_width_m[j] - view.side_m
        along = abs(c * dx + s * dy) - boxes.half_length_m[j]
        slack = max(across, along)
        if slack < 0.0:
            return max(ahead - _LOOK_START_M, 0.05), heading
        ahead += max(slack, _LOOK_STEP_M)
    return np.inf, 0.0
