from __future__ import annotations

import numpy as np
import pytest

from mottrack.world.culling import ScanPattern
from mottrack.world.ego import rotations
from mottrack.world.materials import FENCE, FOLIAGE, PLAIN, Surface, material_table
from mottrack.world.raycast import GROUND, SceneGeometry, cast
from mottrack.world.sensor import SENSORS
from mottrack.world.solids import BOX, CYLINDER, ELLIPSOID, SolidsBuilder
from mottrack.world.terrain import GridFrame, Terrain, heights_at

from .oracle import nearest

WALL = Surface(PLAIN, 0.3)


def flat(height_m: float = -1000.0) -> Terrain:
    grid = np.full((41, 41), height_m, dtype=np.float32)
    return Terrain(grid, np.zeros((41, 41), np.int8), GridFrame(-200.0, -200.0, 0.1))


def make_scan(columns=90, elevation_deg=(-20.0, -8.0, -3.0, 0.0, 4.0), **kw) -> ScanPattern:
    fired = (np.arange(columns) + 0.5) / columns
    time = (fired - 1.0) * kw.get("period_s", 0.1)
    posture = np.zeros((columns, 6))
    posture[:, 2] = 1.8
    posture[:, :2] = time[:, None] * kw.get("velocity", (0.0, 0.0))
    posture[:, 3] = time * kw.get("yaw_rate", 0.0)
    posture[:, 4:] = kw.get("tilt", (0.0, 0.0))
    elevation = np.deg2rad(elevation_deg)
    return ScanPattern(
        time_s=time,
        origin_m=posture[:, :3].copy(),
        rotation=rotations(posture),
        azimuth_rad=kw.get("start", np.pi) - 2.0 * np.pi * fired,
        elevation_rad=elevation,
        offset_rad=np.deg2rad(kw.get("offset_deg", np.zeros(len(elevation)))),
        max_range_m=90.0,
    )


def random_solids(rng, count, *, moving: bool):
    build = SolidsBuilder()
    for _ in range(count):
        r, a = rng.uniform(4.0, 60.0), rng.uniform(-np.pi, np.pi)
        half = rng.uniform([0.2, 0.2, 0.3], [4.0, 1.5, 2.0])
        centre = (r * np.cos(a), r * np.sin(a), rng.uniform(0.2, 2.5))
        build.add(int(rng.integers(0, 3)), centre, half, WALL, rng.uniform(-3, 3))
    build.add(BOX, (0.0, 9.0, 2.0), (30.0, 0.5, 2.0), WALL, 0.1)
    solids = build.build()
    solids.chamfer_m[:] = (
        rng.uniform(0.0, 0.15, solids.chamfer_m.shape) * (solids.kind == BOX)[:, None]
    )
    if moving:
        solids.velocity_mps[:, :2] = rng.uniform(-35.0, 35.0, (count + 1, 2))
        solids.acceleration_mps2[:, :2] = rng.uniform(-5.0, 5.0, (count + 1, 2))
        solids.yaw_rate_radps[:] = rng.uniform(-1.0, 1.0, count + 1)
    return solids


def direction(scan: ScanPattern, column: int, ring: int) -> np.ndarray:
    azimuth = scan.azimuth_rad[column] + scan.offset_rad[ring]
    e = scan.elevation_rad[ring]
    ray = [np.cos(e) * np.cos(azimuth), np.cos(e) * np.sin(azimuth), np.sin(e)]
    return scan.rotation[column] @ ray


@pytest.mark.parametrize(
    ("seed", "moving", "kw"),
    [
        (0, False, {}),
        (1, True, {}),
        (2, True, {"velocity": (30.0, -5.0), "yaw_rate": 0.6}),
        (3, False, {"tilt": (0.04, -0.03), "start": 0.7}),
        (4, True, {"tilt": (0.02, 0.03), "offset_deg": (-3.0, 0.0, 2.5, -1.0, 4.0)}),
    ],
)
def test_every_beam_meets_what_brute_force_finds(seed, moving, kw):
    scan = make_scan(**kw)
    solids = random_solids(np.random.default_rng(seed), 25, moving=moving)
    returns = cast(scan, SceneGeometry(solids, material_table(), flat()), seed)
    wrong = 0
    for column in range(len(scan.time_s)):
        for ring in range(len(scan.elevation_rad)):
            ray = direction(scan, column, ring)
            t, p = nearest(solids, scan.time_s[column], scan.origin_m[column], ray)
            t = t if t < scan.max_range_m else np.inf
            got = returns.range_m[column, ring]
            if np.isfinite(t) or np.isfinite(got):
                wrong += not (abs(got - t) < 1e-6 and returns.solid[column, ring] == p)
    assert wrong == 0


def test_closed_forms_of_box_ball_and_post():
    build = SolidsBuilder()
    build.add(BOX, (10.0, 0.0, 1.8), (1.0, 3.0, 1.0), WALL)
    build.add(ELLIPSOID, (0.0, 20.0, 1.8), (2.0, 2.0, 2.0), WALL)
    build.add(CYLINDER, (-30.0, 0.0, 1.8), (0.5, 0.5, 5.0), WALL)
    scan = make_scan(360, (0.0,), start=np.pi + np.pi / 360)
    returns = cast(scan, SceneGeometry(build.build(), material_table(), flat()), 0)
    for angle, expected in ((0.0, 9.0), (np.pi / 2, 18.0), (np.pi, 29.5)):
        column = int(np.argmin(np.abs(scan.azimuth_rad - angle)))
        assert returns.range_m[column, 0] == pytest.approx(expected, abs=1e-6)
        assert returns.cosine[column, 0] == pytest.approx(1.0, abs=1e-6)


def test_ground_is_met_where_trigonometry_says_and_hills_hide():
    scan = make_scan(36, tuple(np.linspace(-25.0, -1.3, 20)))
    returns = cast(scan, SceneGeometry(SolidsBuilder().build(), material_table(), flat(0.0)), 0)
    expected = 1.8 / np.sin(-scan.elevation_rad)
    assert np.allclose(returns.range_m, expected, atol=1e-4)
    assert (returns.solid == GROUND).all()


def test_ground_walk_agrees_with_fine_marching_on_rough_ground():
    rng = np.random.default_rng(5)
    x = np.arange(-100, 100, 0.5)
    grid = (0.6 * np.sin(x / 9.0)[None, :] + 0.5 * np.cos(x / 13.0)[:, None]).astype(np.float32)
    terrain = Terrain(grid, np.zeros(grid.shape, np.int8), GridFrame(-100.0, -100.0, 2.0))
    scan = make_scan(24, tuple(np.linspace(-25.0, -1.0, 12)))
    scan.origin_m[:, 2] = 3.0
    returns = cast(scan, SceneGeometry(SolidsBuilder().build(), material_table(), terrain), 0)
    t = np.arange(0.0, 90.0, 0.01)
    for _ in range(60):
        c, r = int(rng.integers(24)), int(rng.integers(12))
        p = scan.origin_m[c] + t[:, None] * direction(scan, c, r)
        under = np.flatnonzero(p[:, 2] < heights_at(terrain, np.ascontiguousarray(p[:, :2])))
        want = t[under[0]] if len(under) else np.inf
        got = returns.range_m[c, r]
        assert got == pytest.approx(want, rel=0.01, abs=0.1) or (np.isinf(want) and got > 88.0)


def test_nothing_is_seen_through_a_wall():
    build = SolidsBuilder()
    build.add(BOX, (10.0, 0.0, 2.0), (0.2, 8.0, 3.0), WALL)
    build.add(BOX, (15.0, 0.0, 0.8), (2.0, 0.9, 0.8), WALL)
    returns = cast(make_scan(720), SceneGeometry(build.build(), material_table(), flat()), 0)
    assert (returns.solid == 0).sum() > 100
    assert (returns.solid == 1).sum() == 0


def test_a_fence_lets_its_share_through_and_leaves_thin_out_exponentially():
    build = SolidsBuilder()
    build.add(BOX, (10.0, 0.0, 1.8), (0.02, 30.0, 5.0), Surface(FENCE, 0.3))
    build.add(BOX, (30.0, 0.0, 1.8), (0.5, 60.0, 30.0), WALL)
    build.add(BOX, (-12.0, 0.0, 1.8), (2.0, 30.0, 6.0), Surface(FOLIAGE, 0.3))
    scan = make_scan(4000, (-2.0, 0.0, 2.0))
    returns = cast(scan, SceneGeometry(build.build(), material_table(), flat()), 3)
    ahead = np.abs(np.angle(np.exp(1j * scan.azimuth_rad))) < 0.9
    share = (returns.solid[ahead] == 0).mean()
    assert share == pytest.approx(material_table().opacity[FENCE], abs=0.04)
    behind = np.abs(np.angle(np.exp(1j * (scan.azimuth_rad - np.pi)))) < 0.5
    depth = returns.range_m[behind][returns.solid[behind] == 2] - 10.0
    free = np.exp(-material_table().density_per_m[FOLIAGE] * 4.0)
    through = 1.0 - (returns.solid[behind] == 2).mean()
    assert 0.3 * free < through < 12.0 * free
    assert 0.3 < np.median(depth) * material_table().density_per_m[FOLIAGE] < 1.8


@pytest.mark.parametrize("name", sorted(SENSORS))
def test_sensor_tables_are_in_order(name):
    model = SENSORS[name]
    assert (np.diff(model.elevation_rad) > 0).all()
    assert len(model.offset_rad) == len(model.elevation_rad)
    assert 900 <= model.columns <= 2000
