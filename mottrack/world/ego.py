"""The true pose of the ego vehicle at any time, and its odometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.pose import Pose
from mottrack.world.states import traffic_states
from mottrack.world.terrain import heights_at
from mottrack.world.world import World

_HALF_TRACK_M = 0.8  # Half the distance of the wheels of an axle: 1.6 m, a passenger car's
_TYRE_REACH_M = 0.5
# body motion on the springs, orders of magnitude of a passenger car: 2.2 and 2.8 degrees at 1 g,
# and a vibration of 1.3 and 1.0 Hz by a fifteenth of a degree
_PITCH_PER_MPS2, _ROLL_PER_MPS2 = 0.004, 0.005
_SHAKE_RAD, _SHAKE_RADPS = (0.0012, 0.001), (8.1, 6.3)


def ego_posture(world: World, time_s: float) -> F64:
    """Return (6,) x, y, z, yaw, pitch, roll of the ego frame: rear axle, on the ground.

    The body follows the ground under the four wheels, squats under acceleration, leans in bends
    and never stands quite still.
    """
    states = traffic_states(world.traffic, world.motion, time_s + world.warm_up_s)
    base, yaw = world.traffic.agents.wheelbase_m[0], float(states.yaw_rad[0])
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    left = np.array([-ahead[1], ahead[0]])
    rear = states.xy_m[0] - 0.5 * base * ahead
    arms = [(0.0, 1.0), (0.0, -1.0), (base, 1.0), (base, -1.0)]
    wheels = np.array([rear + a * ahead + b * _HALF_TRACK_M * left for a, b in arms])
    z = _settled(world, wheels)
    push = states.acceleration_mps2[0, :2]
    pitch = (z[0] + z[1] - z[2] - z[3]) / (2 * base) - _PITCH_PER_MPS2 * float(push @ ahead)
    roll = (z[0] + z[2] - z[1] - z[3]) / (4 * _HALF_TRACK_M) + _ROLL_PER_MPS2 * float(push @ left)
    pitch += _SHAKE_RAD[0] * np.sin(_SHAKE_RADPS[0] * time_s)
    roll += _SHAKE_RAD[1] * np.sin(_SHAKE_RADPS[1] * time_s + 1.0)
    return np.array([rear[0], rear[1], 0.5 * (z[0] + z[1]), yaw, pitch, roll])


def _settled(world: World, wheels_m: F64) -> F64:
    """Return (4,) ground heights at the wheels, averaged over a tyre's and a spring's reach."""
    ring = [[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [2, 0], [-2, 0], [0, 2], [0, -2]]
    around = (wheels_m[:, None, :] + _TYRE_REACH_M * np.array(ring)).reshape(-1, 2)
    heights: F64 = heights_at(world.terrain, around).reshape(4, -1).mean(axis=1)
    return heights


def rotations(posture: F64) -> F64:
    """Return the (N, 3, 3) rotations of (N, 6) postures: yaw, then pitch, then roll."""
    (cy, cp, cr), (sy, sp, sr) = np.cos(posture[:, 3:].T), np.sin(posture[:, 3:].T)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=1)


def pose_of(posture: F64) -> Pose:
    """Return ``world_T_ego`` of a (6,) posture."""
    return Pose(rotations(posture[None])[0], posture[:3])


@dataclass(frozen=True)
class PoseError:
    """Errors of the odometry; jitter is independent from sweep to sweep, drift slow and bounded."""

    jitter_m: float
    """Along x and y."""
    jitter_rad: float
    """Of the heading."""
    drift_m: float
    drift_rad: float
    speed_share: float = 0.003
    """Relative error of the speed that motion compensation uses: a wheel's radius is known so."""


# share of the error of x and y for x, y, z; of the heading's for yaw, pitch, roll. Height and tilt
# are observed by gravity and the suspension, so they err less; by how much is a guess
_JITTER_SHARES = np.array([1.0, 1.0, 0.5, 1.0, 0.5, 0.5])
_DRIFT_SHARES = np.array([1.0, 1.0, 0.3, 1.0, 0.3, 0.3])
_DRIFT_RADPS = 0.31  # A period of 20 s, a scene's length
_DRIFT_PHASE_RAD = np.array([0.0, 1.3, 2.1, 0.7, 1.9, 2.9])  # arbitrary: axes drift apart


def odometry(true: F64, error: PoseError, rng: np.random.Generator, time_s: float) -> Pose:
    """Return ``world_T_ego`` as the vehicle estimates it, for a true (6,) posture."""
    drift = np.sin(_DRIFT_RADPS * time_s + _DRIFT_PHASE_RAD) - np.sin(_DRIFT_PHASE_RAD)
    scale = np.repeat([error.drift_m, error.drift_rad], 3) * _DRIFT_SHARES
    jitter = np.repeat([error.jitter_m, error.jitter_rad], 3) * _JITTER_SHARES
    return pose_of(true + scale * drift + jitter * rng.standard_normal(6))
