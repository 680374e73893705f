"""Simulation of one sweep of a world: scan, cast, receive, compensate for motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I64, Mask
from mottrack.core.pose import rotation_2d
from mottrack.core.sweep import SECOND_NS, Sweep
from mottrack.world.culling import ScanPattern
from mottrack.world.ego import PoseError, ego_posture, odometry, rotations
from mottrack.world.intersect import Vector
from mottrack.world.raycast import GROUND, SceneGeometry, cast
from mottrack.world.receiver import Points, Receiver, receive
from mottrack.world.sensor import SensorModel
from mottrack.world.solids import BACKGROUND
from mottrack.world.states import States
from mottrack.world.world import World

_KNOTS = 5  # Postures computed within a scan; between them 25 ms are straight
_MIN_RANGE_M = 1.5  # The own vehicle, which is not simulated, would hide what is nearer


@dataclass(frozen=True)
class PointTruth:
    """What each of the N points of a sweep belongs to, in the order of the points."""

    object_id: I64
    """(N,) identity as in Truth, -1 for ground and static background."""
    velocity_mps: F32
    """(N, 2) velocity of the rigid object at that point (rotation included, legs not), over the
    ground, in the axes of the sweep's ego frame, at the sweep's stamp; 0 for background."""
    is_ground: Mask
    """(N,) whether the point lies on the ground (road, pavement, grass)."""


@dataclass(frozen=True)
class Rig:
    """The sensor on the vehicle."""

    sensor: SensorModel
    period_s: float
    """Time of one revolution."""
    rolling: bool
    """Whether columns fire one after the other; otherwise the whole revolution is one flash."""
    pose_error: PoseError
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    """Pitch and roll of the sensor against the vehicle (known to the calibration)."""
    edge_share: float = 0.15
    """Share of beams at a depth edge that report a range in between; chosen by eye."""


@dataclass(frozen=True)
class ScanResult:
    """A sweep with its truth."""

    sweep: Sweep
    truth: PointTruth
    states: States
    """All agents at the stamp, world frame."""
    count: I64
    """(agents,) returns on each."""
    posture: F64
    """(6,) true posture of the ego vehicle at the stamp."""


def scan(world: World, rig: Rig, time_s: float, draw: np.random.SeedSequence) -> ScanResult:
    """Simulate the sweep whose revolution ends at ``time_s``, which is its stamp.

    Args:
        world: what is there.
        rig: sensor and mounting.
        time_s: time of the scene.
        draw: source of all noise of this sweep; the same source gives the same bytes.
    """
    rng = np.random.default_rng(draw)
    ray_seed, noise_seed = (int(s) for s in rng.integers(0, 2**62, 2))
    posture, sensor = ego_posture(world, time_s), rig.sensor
    pattern = _scan_pattern(world, rig, time_s)
    solids = world.solids(time_s, posture[:2], sensor.max_range_m)
    scene = SceneGeometry(solids, world.materials, world.terrain)
    returns = cast(pattern, scene, ray_seed)
    receiver = Receiver(
        sensor.reach_m, _MIN_RANGE_M, sensor.range_noise_m, sensor.drop_out, rig.edge_share
    )
    points = receive(pattern, returns, scene, receiver, noise_seed)
    hit = returns.solid[points.column, points.ring]
    owner = np.where(hit >= 0, solids.owner[np.maximum(hit, 0)], BACKGROUND)
    xyz = _to_ego(pattern, points, posture[:3], rotations(posture[None])[0])
    xyz -= _compensation_error(pattern, points, posture, rig, rng.standard_normal())
    sweep = Sweep(
        xyz_m=xyz.astype(np.float32),
        reflectance=points.reflectance,
        stamp_ns=round(time_s * SECOND_NS),
        world_T_ego=odometry(posture, rig.pose_error, rng, time_s),
        origin_m=np.array([sensor.forward_m, 0.0, sensor.height_m]),
        time_offset_ns=np.rint(pattern.time_s * SECOND_NS).astype(np.int64)[points.column],
        ring=points.ring.astype(np.int16),
    )
    states = world.states(time_s)
    velocity = _velocities(sweep, owner, states, posture)
    truth = PointTruth(owner, velocity, hit == GROUND)
    count = np.bincount(owner[owner >= 0], minlength=len(world.label))
    return ScanResult(sweep, truth, states, count, posture)


def _scan_pattern(world: World, rig: Rig, time_s: float) -> ScanPattern:
    sensor, columns = rig.sensor, rig.sensor.columns
    fired = (np.arange(columns) + 0.5) / columns
    offset = (fired - 1.0) * rig.period_s if rig.rolling else np.zeros(columns)
    knots = np.linspace(-rig.period_s, 0.0, _KNOTS)
    postures = np.array([ego_posture(world, time_s + k) for k in knots])
    posture = np.column_stack([np.interp(offset, knots, column) for column in postures.T])
    ego = rotations(posture)
    mount = np.array([sensor.forward_m, 0.0, sensor.height_m])
    tilt = rotations(np.array([[0.0, 0.0, 0.0, 0.0, *rig.tilt_rad]]))[0]
    direction = -1.0 if sensor.clockwise else 1.0
    return ScanPattern(
        time_s=offset,
        origin_m=posture[:, :3] + ego @ mount,
        rotation=np.ascontiguousarray(ego @ tilt),
        azimuth_rad=sensor.start_rad + direction * 2.0 * np.pi * fired,
        elevation_rad=sensor.elevation_rad,
        offset_rad=sensor.offset_rad,
        max_range_m=sensor.max_range_m,
    )


def _compensation_error(
    pattern: ScanPattern, points: Points, posture: F64, rig: Rig, draw: float
) -> F64:
    """Return (N, 3) by how much a wrong speed of the odometry shifts the points."""
    travel = (pattern.origin_m[-1] - pattern.origin_m[0]) @ rotations(posture[None])[0]
    late: F64 = pattern.time_s[points.column] / rig.period_s
    return np.outer(late * rig.pose_error.speed_share * draw, travel)


@compiled
def _to_ego(pattern: ScanPattern, points: Points, place_m: F64, world_R_ego: F64) -> F64:
    """Return (N, 3) the reported points in the ego frame at the stamp."""
    out = np.empty((len(points.column), 3))
    rings = np.empty((len(pattern.elevation_rad), 2))
    for k in range(len(rings)):
        elevation = pattern.elevation_rad[k]
        rings[k, 0], rings[k, 1] = np.cos(elevation), np.sin(elevation)
    rotation, origin, column, ring = pattern.rotation, pattern.origin_m, points.column, points.ring
    for i in range(len(out)):
        c, e = column[i], ring[i]
        azimuth = pattern.azimuth_rad[c] + pattern.offset_rad[e]
        ray = Vector(rings[e, 0] * np.cos(azimuth), rings[e, 0] * np.sin(azimuth), rings[e, 1])
        r, o = points.range_m[i], place_m
        x = origin[c, 0] - o[0] + r * _rotated(rotation, c, 0, ray)
        y = origin[c, 1] - o[1] + r * _rotated(rotation, c, 1, ray)
        z = origin[c, 2] - o[2] + r * _rotated(rotation, c, 2, ray)
        for axis in range(3):
            out[i, axis] = (
                world_R_ego[0, axis] * x + world_R_ego[1, axis] * y + world_R_ego[2, axis] * z
            )
    return out


@compiled(inline="always")
def _rotated(rotation: F64, c: int, axis: int, ray: Vector) -> float:
    """Return one coordinate of a direction rotated by the rotation of a column."""
    level = rotation[c, axis, 0] * ray.x + rotation[c, axis, 1] * ray.y
    return float(level + rotation[c, axis, 2] * ray.z)


def _velocities(sweep: Sweep, owner: I64, states: States, posture: F64) -> F32:
    """Return the (N, 2) rigid velocity of each point in ego axes."""
    out = np.zeros((len(owner), 2))
    hit = np.flatnonzero(owner != BACKGROUND)
    row = owner[hit]
    world_R_ego = rotation_2d(posture[3])
    velocity = states.velocity_mps[row, :2] @ world_R_ego
    centre = (states.xy_m[row] - posture[:2]) @ world_R_ego
    arm = sweep.xyz_m[hit, :2] - centre
    rate = states.yaw_rate_radps[row]
    out[hit] = velocity + np.column_stack([-rate * arm[:, 1], rate * arm[:, 0]])
    return out.astype(np.float32)
