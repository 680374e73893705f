"""How movers follow their routes: a car-following model with right of way by sight.

Acceleration is that of the Intelligent Driver Model (Treiber, Hennecke and Helbing, Phys. Rev. E
62, 2000), towards the nearest thing that stands on the own path, the stop line of a red light, or
a bend that asks for a lower speed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64
from mottrack.world.curves import Paths, sample
from mottrack.world.signals import NO_SIGNAL, Signals, is_green
from mottrack.world.traffic import Traffic

STEP_S = 0.1
_LATERAL_MPS2 = 2.2
_HARDEST_MPS2 = 6.0
_LOOK_STEP_M = 1.5
_KERB_M = 0.8


class Actors(NamedTuple):
    """What the simulation knows of N movers; named tuple for numba."""

    path: I64
    size_m: F64
    wish_mps: F64
    lateral_m: F64
    driver: F64
    stop_m: F64
    approach: I64
    towed_by: I64


class Motion(NamedTuple):
    """T steps of N movers, STEP_S apart; within a step the acceleration is constant."""

    s_m: F64
    """(T, N) arc length of the rear axle (of the middle where there are no axles)."""
    speed_mps: F64
    acceleration_mps2: F64


def actors_of(traffic: Traffic) -> Actors:
    """The numbers of a Traffic that driving needs."""
    routes = [traffic.routes[p] for p in traffic.path]
    limit = np.array([r.speed_limit_mps for r in routes])
    return Actors(
        path=traffic.path,
        size_m=traffic.size_m,
        wish_mps=traffic.wish * limit,
        lateral_m=traffic.lateral_m,
        driver=traffic.driver,
        stop_m=np.array([r.stop_m for r in routes]),
        approach=np.array([r.approach for r in routes]),
        towed_by=traffic.towed_by,
    )


def simulate(traffic: Traffic, signals: Signals, times_s: tuple[float, float]) -> Motion:
    """Moves everybody from a first to a last time in steps of STEP_S."""
    steps = round((times_s[1] - times_s[0]) / STEP_S) + 1
    start = (traffic.start_m, traffic.speed_mps)
    clock = (steps, times_s[0])
    motion: Motion = _simulate(actors_of(traffic), traffic.paths, signals, start, clock)
    return motion


@compiled
def _simulate(
    actors: Actors,
    paths: Paths,
    signals: Signals,
    start: tuple[F64, F64],
    clock: tuple[int, float],
) -> Motion:
    steps, begin_s = clock
    n = len(actors.path)
    motion = Motion(np.empty((steps, n)), np.empty((steps, n)), np.zeros((steps, n)))
    motion.s_m[0], motion.speed_mps[0] = start
    boxes = np.empty((n, 6))
    for k in range(steps):
        s, v = motion.s_m[k], motion.speed_mps[k]
        _place(actors, paths, s, v, boxes)
        for i in range(n):
            pull = actors.towed_by[i]
            if pull >= 0:
                motion.acceleration_mps2[k, i] = motion.acceleration_mps2[k, pull]
                continue
            green = is_green(signals, actors.approach[i], begin_s + k * STEP_S)
            red = actors.approach[i] != NO_SIGNAL and not green
            a = _acceleration(actors, paths, boxes, i, (s[i], v[i], red))
            motion.acceleration_mps2[k, i] = max(a, -v[i] / STEP_S)
        if k + 1 < steps:
            a = motion.acceleration_mps2[k]
            motion.s_m[k + 1] = s + v * STEP_S + 0.5 * a * STEP_S * STEP_S
            motion.speed_mps[k + 1] = np.maximum(v + a * STEP_S, 0.0)
    return motion


@compiled
def _place(
    actors: Actors,
    paths: Paths,
    s: F64,
    v: F64,
    boxes: F64,
) -> None:
    """Fills (N, 6): x, y, heading, half length, half width, speed."""
    for i in range(len(s)):
        x, y, heading, _ = sample(paths, actors.path[i], s[i])
        ahead, left = 0.5 * actors.driver[i, 4], actors.lateral_m[i]
        boxes[i, 0] = x + ahead * np.cos(heading) - left * np.sin(heading)
        boxes[i, 1] = y + ahead * np.sin(heading) + left * np.cos(heading)
        boxes[i, 2], boxes[i, 5] = heading, v[i]
        boxes[i, 3], boxes[i, 4] = 0.5 * actors.size_m[i, 0], 0.5 * actors.size_m[i, 1]


@compiled
def _acceleration(
    actors: Actors,
    paths: Paths,
    boxes: F64,
    i: int,
    state: tuple[float, float, bool],
) -> float:
    s, v, red = state
    if actors.wish_mps[i] <= 0.0:
        return -min(v / STEP_S, 1.0)
    driver = actors.driver[i]
    front = s + 0.5 * (driver[4] + actors.size_m[i, 0])
    look = 12.0 + 3.2 * v
    wish = _bend_speed(paths, actors.path[i], (s, v, actors.wish_mps[i]))
    gap, leader = _gap_ahead(actors, paths, boxes, i, (front, min(look, 90.0)))
    to_line = actors.stop_m[i] - front
    can_stop = v * v < 2.0 * 3.5 * max(to_line, 0.01)
    if red and -0.5 < to_line < gap and can_stop:
        gap, leader = to_line, 0.0
    if red and np.isinf(actors.stop_m[i]) and s < _KERB_M:
        gap, leader = min(gap, 0.05), 0.0
    return float(_following(driver, (v, max(wish, 0.3)), (gap, leader)))


@compiled
def _following(driver: F64, speed: tuple[float, float], ahead: tuple[float, float]) -> float:
    """IDM, eq. (2) and (3) of the paper: a [1 - (v/v0)^4 - (s*/s)^2]."""
    v, wish = speed
    gap, leader = ahead
    a, b = driver[0], driver[1]
    wanted = driver[2] + max(v * driver[3] + v * (v - leader) / (2.0 * np.sqrt(a * b)), 0.0)
    free = 1.0 - min(v / wish, 2.0) ** 4
    brake = (wanted / max(gap, 0.1)) ** 2 if gap < 1e6 else 0.0
    return float(max(a * (free - brake), -_HARDEST_MPS2))


@compiled
def _bend_speed(paths: Paths, path: int, state: tuple[float, float, float]) -> float:
    """The wished speed, lowered so that bends within braking distance are taken gently."""
    s, v, wish = state
    ahead, reach = 0.0, 6.0 + v * v / 3.0
    while ahead < reach:
        curvature = abs(sample(paths, path, s + ahead)[3])
        bend = np.sqrt(_LATERAL_MPS2 / max(curvature, 1e-4))
        wish = min(wish, np.sqrt(bend * bend + 2.0 * 1.2 * ahead))
        ahead += 3.0
    return wish


@compiled
def _gap_ahead(
    actors: Actors,
    paths: Paths,
    boxes: F64,
    i: int,
    view: tuple[float, float],
) -> tuple[float, float]:
    """(distance to the first thing on the own path, its speed along the path); inf if clear."""
    front, look = view
    best, leader = np.inf, 0.0
    on_foot = actors.driver[i, 4] <= 0.0
    side = 0.5 * boxes[i, 4] if on_foot else boxes[i, 4] + 0.25
    for j in range(len(boxes)):
        dx, dy = boxes[j, 0] - boxes[i, 0], boxes[j, 1] - boxes[i, 1]
        reach = look + boxes[j, 3] + boxes[i, 3]
        ahead = dx * np.cos(boxes[i, 2]) + dy * np.sin(boxes[i, 2])
        if (
            i == j
            or actors.towed_by[j] == i
            or dx * dx + dy * dy > reach * reach
            or ahead < -0.5 * look
        ):
            continue
        gap, heading = _first_inside(paths, actors, boxes[j], (i, front, min(look, best), side))
        if gap < best:
            best, leader = gap, max(boxes[j, 5] * np.cos(boxes[j, 2] - heading), 0.0)
    return best, leader


@compiled
def _first_inside(
    paths: Paths,
    actors: Actors,
    box: F64,
    view: tuple[int, float, float, float],
) -> tuple[float, float]:
    """(way until the own path enters a box, heading there); inf if it does not."""
    i, front, look, side = view
    left = actors.lateral_m[i]
    c, s = np.cos(box[2]), np.sin(box[2])
    ahead = 0.2
    while ahead < look:
        x, y, heading, _ = sample(paths, actors.path[i], front + ahead)
        dx, dy = x - left * np.sin(heading) - box[0], y + left * np.cos(heading) - box[1]
        across = abs(c * dy - s * dx) - box[4] - side
        along = abs(c * dx + s * dy) - box[3]
        slack = max(across, along)
        if slack < 0.0:
            return max(ahead - 0.2, 0.05), heading
        ahead += max(slack, _LOOK_STEP_M)
    return np.inf, 0.0
