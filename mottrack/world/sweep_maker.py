"""Makes one sweep of a world: scan, cast, receive, compensate for motion."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I64, Mask
from mottrack.core.sweep import Sweep
from mottrack.world import raycast
from mottrack.world.culling import Scan
from mottrack.world.ego import PoseError, ego_posture, odometry, rotations
from mottrack.world.receiver import Points, Receiver, is_ground, receive
from mottrack.world.sensor import SensorModel
from mottrack.world.solids import BACKGROUND
from mottrack.world.states import States
from mottrack.world.world import World

_KNOTS = 5
_MIN_RANGE_M = 1.5


@dataclass(frozen=True)
class PointTruth:
    """What each of the N points of a sweep belongs to, in the order of the points."""

    object_id: I64
    """(N,) identity as in Truth, -1 for ground and static background."""
    velocity_mps: F32
    """(N, 2) velocity of the rigid object at that point (turning included, legs not), over the
    ground, in the axes of the sweep's ego frame, at the sweep's stamp; 0 for background."""
    is_ground: Mask
    """(N,) whether the point lies on the ground (road, pavement, grass)."""


@dataclass(frozen=True)
class Rig:
    """The sensor on the vehicle."""

    sensor: SensorModel
    period_s: float
    """Time of one turn."""
    rolling: bool = True
    """Whether columns fire one after the other; otherwise the whole turn is one flash."""
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    """Pitch and roll of the sensor against the vehicle (known to the calibration)."""
    edge_share: float = 0.15
    pose_error: PoseError = field(default_factory=PoseError)


@dataclass(frozen=True)
class ScanResult:
    """A sweep with its truth."""

    sweep: Sweep
    truth: PointTruth
    states: States
    """All movers at the stamp, world frame."""
    count: I64
    """(N movers,) returns on each."""
    posture: F64
    """(6,) true posture of the ego vehicle at the stamp."""


def scan(world: World, rig: Rig, time_s: float, draw: np.random.SeedSequence) -> ScanResult:
    """The sweep whose turn ends at ``time_s``, which is its stamp.

    Args:
        world: what is there.
        rig: sensor and mounting.
        time_s: time of the scene.
        draw: source of all noise of this sweep; the same source gives the same bytes.
    """
    rng = np.random.default_rng(draw)
    ray_seed, noise_seed = (int(s) for s in rng.integers(0, 2**62, 2))
    posture = ego_posture(world, time_s)
    scan = _scan(world, rig, time_s)
    solids = world.solids(time_s, posture[:2], rig.sensor.max_range_m)
    scene = raycast.World(solids, world.materials, world.terrain)
    returns = raycast.cast(scan, scene, ray_seed)
    sensor = rig.sensor
    receiver = Receiver(
        sensor.reach_m, _MIN_RANGE_M, sensor.range_noise_m, sensor.drop_out, rig.edge_share
    )
    points = receive(scan, returns, (solids, world.materials), receiver, noise_seed)
    owner = raycast.owners(returns, solids)[points.column, points.ring]
    sweep = _sweep(scan, points, (posture, rig, rng), time_s)
    states = world.states(time_s)
    ground = is_ground(returns, points)
    truth = PointTruth(owner, _velocities(sweep, owner, states, posture), ground)
    count = np.bincount(owner[owner >= 0], minlength=len(world.label))
    return ScanResult(sweep, truth, states, count, posture)


def _scan(world: World, rig: Rig, time_s: float) -> Scan:
    sensor, columns = rig.sensor, rig.sensor.columns
    turn = (np.arange(columns) + 0.5) / columns
    offset = (turn - 1.0) * rig.period_s if rig.rolling else np.zeros(columns)
    knots = np.linspace(-rig.period_s, 0.0, _KNOTS)
    postures = np.array([ego_posture(world, time_s + k) for k in knots])
    posture = np.column_stack([np.interp(offset, knots, column) for column in postures.T])
    ego = rotations(posture)
    mount = np.array([sensor.forward_m, 0.0, sensor.height_m])
    tilt = rotations(np.array([[0.0, 0.0, 0.0, 0.0, *rig.tilt_rad]]))[0]
    direction = -1.0 if sensor.clockwise else 1.0
    return Scan(
        time_s=offset,
        origin_m=posture[:, :3] + ego @ mount,
        rotation=np.ascontiguousarray(ego @ tilt),
        azimuth_rad=sensor.start_rad + direction * 2.0 * np.pi * turn,
        elevation_rad=sensor.elevation_rad,
        offset_rad=sensor.offset_rad,
        max_range_m=sensor.max_range_m,
    )


def _sweep(
    scan: Scan,
    points: Points,
    state: tuple[F64, Rig, np.random.Generator],
    time_s: float,
) -> Sweep:
    """Points in the ego frame at the stamp, moved there by a slightly wrong odometry."""
    posture, rig, rng = state
    ego = rotations(posture[None])[0]
    xyz = _to_ego(scan, points, posture[:3], ego)
    travel = (scan.origin_m[-1] - scan.origin_m[0]) @ ego
    late = scan.time_s[points.column] / rig.period_s
    xyz -= (late * rig.pose_error.speed_share * rng.standard_normal())[:, None] * travel
    return Sweep(
        xyz_m=xyz.astype(np.float32),
        reflectance=points.reflectance,
        stamp_ns=round(time_s * 1e9),
        world_T_ego=odometry(posture, rig.pose_error, rng, time_s),
        origin_m=np.array([rig.sensor.forward_m, 0.0, rig.sensor.height_m]),
        time_offset_ns=np.rint(scan.time_s * 1e9).astype(np.int64)[points.column],
        ring=points.ring.astype(np.int16),
    )


@compiled
def _to_ego(scan: Scan, points: Points, place_m: F64, turn: F64) -> F64:
    """(N, 3) reported points in the ego frame at the stamp."""
    out = np.empty((len(points.column), 3))
    rings = np.empty((len(scan.elevation_rad), 2))
    rings[:, 0], rings[:, 1] = np.cos(scan.elevation_rad), np.sin(scan.elevation_rad)
    rotation, origin, column, ring = scan.rotation, scan.origin_m, points.column, points.ring
    for i in range(len(out)):
        c, e = column[i], ring[i]
        azimuth = scan.azimuth_rad[c] + scan.offset_rad[e]
        x, y, z = rings[e, 0] * np.cos(azimuth), rings[e, 0] * np.sin(azimuth), rings[e, 1]
        r, o = points.range_m[i], place_m
        wx = origin[c, 0] - o[0] + r * _turned(rotation, c, 0, (x, y, z))
        wy = origin[c, 1] - o[1] + r * _turned(rotation, c, 1, (x, y, z))
        wz = origin[c, 2] - o[2] + r * _turned(rotation, c, 2, (x, y, z))
        for axis in range(3):
            out[i, axis] = turn[0, axis] * wx + turn[1, axis] * wy + turn[2, axis] * wz
    return out


@compiled(inline="always")
def _turned(rotation: F64, c: int, axis: int, ray: tuple[float, float, float]) -> float:
    """One coordinate of a direction turned by the rotation of a column."""
    level = rotation[c, axis, 0] * ray[0] + rotation[c, axis, 1] * ray[1]
    return float(level + rotation[c, axis, 2] * ray[2])


def _velocities(sweep: Sweep, owner: I64, states: States, posture: F64) -> F32:
    """(N, 2) rigid velocity of each point in ego axes."""
    c, s = np.cos(posture[3]), np.sin(posture[3])
    out = np.zeros((len(owner), 2))
    hit = np.flatnonzero(owner != BACKGROUND)
    who = owner[hit]
    ego_R_world = np.array([[c, s], [-s, c]])
    velocity = states.velocity_mps[who, :2] @ ego_R_world.T
    centre = (states.xy_m[who] - posture[:2]) @ ego_R_world.T
    arm = sweep.xyz_m[hit, :2] - centre
    rate = states.yaw_rate_radps[who]
    out[hit] = velocity + np.column_stack([-rate * arm[:, 1], rate * arm[:, 0]])
    return out.astype(np.float32)
