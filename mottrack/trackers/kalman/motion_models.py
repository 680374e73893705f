"""How objects move: batched, stateless models over the tracker's state.

Each model takes states (N, D) = (x, y, z, a, l, w, h, d_x, d_y, d_z, d_a[, a_x, a_y]) and steps
dt_s (N,), and returns the states after the step and the Jacobians (N, D, D). Velocities are
Cartesian in all of them, so a measured velocity is a linear observation of every model and the
models of an IMM mix as they are.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mottrack.core.arrays import F64

MotionModel = Callable[[F64, F64], tuple[F64, F64]]

X, Y, Z, YAW, LENGTH, VX, VY, TURN, AX, AY = 0, 1, 2, 3, 4, 7, 8, 10, 11, 12

SMALL_TURN_RAD = 1e-4
REAR_AXLE = 0.3
"""Distance of the rear axle from the centre, as a part of the length."""
FASTEST_TURN_RPS = 1.5
"""No road vehicle turns faster; a heading that is off sideways would ask for more."""


def constant_velocity(state: F64, dt_s: F64) -> tuple[F64, F64]:
    """Straight on: x' = x + t d_x, and so for y, z and the heading; acceleration is forgotten."""
    jacobian = _identity(state)
    for axis in (X, Y, Z, YAW):
        jacobian[:, axis, axis + 7] = dt_s
    if state.shape[1] > AX:
        jacobian[:, AX, AX] = jacobian[:, AY, AY] = 0.0
    return _apply(jacobian, state), jacobian


def constant_acceleration(state: F64, dt_s: F64) -> tuple[F64, F64]:
    """Along its path x' = x + t d_x + t^2 / 2 a_x and d_x' = d_x + t a_x, and so for y."""
    _, jacobian = constant_velocity(state, dt_s)
    for axis in (X, Y):
        jacobian[:, axis, axis + AX] = dt_s**2 / 2
        jacobian[:, axis + VX, axis + AX] = dt_s
        jacobian[:, axis + AX, axis + AX] = 1.0
    return _apply(jacobian, state), jacobian


def constant_turn(state: F64, dt_s: F64) -> tuple[F64, F64]:
    """Constant turn rate and speed (CTRV): the velocity turns with the heading, by d_a t."""
    turn = np.zeros((len(state), state.shape[1]))
    turn[:, TURN] = 1.0
    return _turned(state, dt_s, state[:, TURN], turn)


def bicycle(state: F64, dt_s: F64) -> tuple[F64, F64]:
    """Kinematic bicycle: no slip at the rear axle, l_r behind the centre.

    The lateral velocity of the centre is then u = l_r d_a, so the turn rate follows from velocity,
    heading and length, and the velocity turns with the heading as in CTRV. A box may face
    backwards: the heading's nearer end is taken for the front.
    """
    cos, sin = np.cos(state[:, YAW]), np.sin(state[:, YAW])
    forward = cos * state[:, VX] + sin * state[:, VY]
    sideways = cos * state[:, VY] - sin * state[:, VX]
    front = np.where(forward < 0, -1.0, 1.0)
    lever = REAR_AXLE * np.maximum(state[:, LENGTH], 0.5)
    rate = front * sideways / lever
    free = np.abs(rate) < FASTEST_TURN_RPS
    gradient = np.zeros_like(state)
    gradient[:, VX] = -front * sin / lever
    gradient[:, VY] = front * cos / lever
    gradient[:, YAW] = -front * forward / lever
    gradient[:, LENGTH] = np.where(state[:, LENGTH] > 0.5, -rate / state[:, LENGTH], 0.0)
    gradient *= free[:, None]
    return _turned(state, dt_s, np.clip(rate, -FASTEST_TURN_RPS, FASTEST_TURN_RPS), gradient)


def _turned(state: F64, dt_s: F64, rate: F64, rate_gradient: F64) -> tuple[F64, F64]:
    """A turn at `rate` (N,), which depends on the state by `rate_gradient` (N, D)."""
    after, jacobian = constant_velocity(state, dt_s)
    angle = rate * dt_s
    along, across, d_along, d_across = _arc(rate, dt_s)
    cos, sin = np.cos(angle), np.sin(angle)
    vx, vy = state[:, VX], state[:, VY]
    after[:, X] = state[:, X] + along * vx - across * vy
    after[:, Y] = state[:, Y] + across * vx + along * vy
    after[:, YAW] = state[:, YAW] + angle
    after[:, VX], after[:, VY] = cos * vx - sin * vy, sin * vx + cos * vy
    after[:, TURN] = rate
    jacobian[:, X, VX], jacobian[:, X, VY] = along, -across
    jacobian[:, Y, VX], jacobian[:, Y, VY] = across, along
    jacobian[:, VX, VX], jacobian[:, VX, VY] = cos, -sin
    jacobian[:, VY, VX], jacobian[:, VY, VY] = sin, cos
    jacobian[:, YAW, TURN] = jacobian[:, TURN, TURN] = 0.0
    by_rate = {
        X: d_along * vx - d_across * vy,
        Y: d_across * vx + d_along * vy,
        YAW: dt_s,
        VX: -dt_s * after[:, VY],
        VY: dt_s * after[:, VX],
        TURN: np.ones_like(dt_s),
    }
    for row, slope in by_rate.items():
        jacobian[:, row, :] += slope[:, None] * rate_gradient
    return after, jacobian


def _arc(rate: F64, dt_s: F64) -> tuple[F64, F64, F64, F64]:
    """sin(w t) / w and (1 - cos(w t)) / w and their derivatives by w, by series near w = 0."""
    straight = np.abs(rate * dt_s) < SMALL_TURN_RAD
    w = np.where(straight, 1.0, rate)
    angle = w * dt_s
    along, across = np.sin(angle) / w, (1.0 - np.cos(angle)) / w
    d_along = (dt_s * np.cos(angle) - along) / w
    d_across = (dt_s * np.sin(angle) - across) / w
    small = np.where(straight, rate, 0.0) * dt_s
    return (
        np.where(straight, dt_s * (1 - small**2 / 6), along),
        np.where(straight, dt_s * small / 2, across),
        np.where(straight, -(dt_s**2) * small / 3, d_along),
        np.where(straight, dt_s**2 * (0.5 - small**2 / 8), d_across),
    )


def _identity(state: F64) -> F64:
    n, d = state.shape
    return np.broadcast_to(np.eye(d), (n, d, d)).copy()


def _apply(jacobian: F64, state: F64) -> F64:
    return np.asarray((jacobian @ state[:, :, None])[:, :, 0])


MOTION_MODELS: dict[str, MotionModel] = {
    "cv": constant_velocity,
    "ca": constant_acceleration,
    "ctrv": constant_turn,
    "bicycle": bicycle,
}
