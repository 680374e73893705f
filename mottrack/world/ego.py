"""The ego vehicle's pose at any time, and what its odometry makes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.pose import Pose
from mottrack.world.states import traffic_states
from mottrack.world.terrain import heights_at
from mottrack.world.world import World

_HALF_TRACK_M = 0.8


def ego_posture(world: World, time_s: float) -> F64:
    """(6,) x, y, z, yaw, pitch, roll of the ego frame: rear axle, on the ground.

    The body follows the ground under the four wheels, squats under acceleration, leans in bends
    and never stands quite still.
    """
    states = traffic_states(world.traffic, world.motion, time_s + world.warm_up_s)
    base, yaw = world.traffic.driver[0, 4], float(states.yaw_rad[0])
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    left = np.array([-ahead[1], ahead[0]])
    rear = states.xy_m[0] - 0.5 * base * ahead
    arms = [(0.0, 1.0), (0.0, -1.0), (base, 1.0), (base, -1.0)]
    wheels = np.array([rear + a * ahead + b * _HALF_TRACK_M * left for a, b in arms])
    z = _settled(world, wheels)
    push = states.acceleration_mps2[0, :2]
    shake = 0.0012 * np.sin(8.1 * time_s), 0.001 * np.sin(6.3 * time_s + 1.0)
    pitch = (z[0] + z[1] - z[2] - z[3]) / (2 * base) - 0.004 * float(push @ ahead) + shake[0]
    roll = (z[0] + z[2] - z[1] - z[3]) / (4 * _HALF_TRACK_M) + 0.005 * float(push @ left) + shake[1]
    return np.array([rear[0], rear[1], 0.5 * (z[0] + z[1]), yaw, pitch, roll])


def _settled(world: World, wheels_m: F64) -> F64:
    """(4,) ground heights at the wheels, smoothed over a tyre's and a spring's reach."""
    ring = 0.5 * np.array(
        [[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [2, 0], [-2, 0], [0, 2], [0, -2]]
    )
    around = (wheels_m[:, None, :] + ring).reshape(-1, 2)
    return np.asarray(heights_at(world.terrain, around).reshape(4, -1).mean(axis=1))


def rotations(posture: F64) -> F64:
    """(N, 3, 3) rotations of (N, 6) postures: yaw, then pitch, then roll."""
    (cy, cp, cr), (sy, sp, sr) = np.cos(posture[:, 3:].T), np.sin(posture[:, 3:].T)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=1)


def pose_of(posture: F64) -> Pose:
    """``world_T_ego`` of a (6,) posture."""
    return Pose(rotations(posture[None])[0], posture[:3])


@dataclass(frozen=True)
class PoseError:
    """How wrong the odometry is."""

    jitter_m: float = 0.01
    """Independent from sweep to sweep, each axis."""
    jitter_rad: float = 0.0006
    drift_m: float = 0.05
    """Slow and bounded."""
    drift_rad: float = 0.001
    speed_share: float = 0.003
    """Error of the speed that motion compensation uses, as a share."""


def odometry(true: F64, error: PoseError, rng: np.random.Generator, time_s: float) -> Pose:
    """``world_T_ego`` as the vehicle believes it, for a true (6,) posture."""
    phase = np.array([0.0, 1.3, 2.1, 0.7, 1.9, 2.9])
    drift = np.sin(0.31 * time_s + phase) - np.sin(phase)
    scale = np.array(
        [error.drift_m] * 2 + [0.3 * error.drift_m, error.drift_rad] + [0.3 * error.drift_rad] * 2
    )
    jitter = np.array(
        [error.jitter_m] * 2
        + [0.5 * error.jitter_m, error.jitter_rad]
        + [0.5 * error.jitter_rad] * 2
    )
    return pose_of(true + scale * drift + jitter * rng.standard_normal(6))
