"""Milliseconds a sweep of the embedded world, against a caster without culling.

One thread. CPU time, minimum of several runs, since it is what the code costs and not what else
the machine does. The peer tests every ray against every solid with the same intersection code.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from _common import arguments, report
from numba import njit

from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset
from mottrack.world import training_pair
from mottrack.world.bodies import gather, make_body
from mottrack.world.catalogue import draw_size
from mottrack.world.culling import ScanPattern
from mottrack.world.intersect import Vector, hit_box, hit_cylinder, hit_ellipsoid
from mottrack.world.materials import material_table
from mottrack.world.raycast import SceneGeometry, cast
from mottrack.world.receiver import Receiver, receive
from mottrack.world.sensor import SENSORS
from mottrack.world.solids import Solids
from mottrack.world.states import place_bodies, resting
from mottrack.world.sweep_maker import scan
from mottrack.world.terrain import GridFrame, Terrain


def best_ms(work: Callable[[], Any], runs: int) -> float:
    work()
    times = []
    for _ in range(runs):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return 1e3 * min(times)


def objects(count: int, seed: int = 0) -> Solids:
    """Cars, people and others around the sensor, five metres and more away."""
    rng = np.random.default_rng(seed)
    label = rng.choice(
        np.array(["car", "truck", "pedestrian", "bicycle"]), count, p=[0.6, 0.1, 0.2, 0.1]
    )
    bodies = [make_body(rng, str(name), draw_size(rng, str(name))) for name in label]
    away, angle = rng.uniform(6.0, 70.0, count), rng.uniform(-np.pi, np.pi, count)
    xy = np.column_stack([away * np.cos(angle), away * np.sin(angle)])
    states = resting(xy, rng.uniform(-np.pi, np.pi, count))
    return place_bodies(gather(bodies), states, np.zeros(count))


def scan_pattern() -> ScanPattern:
    """35,000 rays: 32 rings, 1085 columns, a vehicle at 10 m/s."""
    sensor = SENSORS["uniform32"]
    fired = (np.arange(sensor.columns) + 0.5) / sensor.columns
    origin = np.zeros((sensor.columns, 3))
    origin[:, 0], origin[:, 2] = fired - 1.0, 1.84
    return ScanPattern(
        time_s=0.1 * (fired - 1.0),
        origin_m=origin,
        rotation=np.tile(np.eye(3), (sensor.columns, 1, 1)),
        azimuth_rad=np.pi - 2.0 * np.pi * fired,
        elevation_rad=sensor.elevation_rad,
        offset_rad=sensor.offset_rad,
        max_range_m=100.0,
    )


@njit(cache=True, error_model="numpy")
def without_culling(pattern: ScanPattern, solids: Solids) -> np.ndarray:
    """Range of the first solid of every ray, each ray against each solid; no ground."""
    out = np.full((len(pattern.time_s), len(pattern.elevation_rad)), np.inf)
    for column in range(out.shape[0]):
        for ring in range(out.shape[1]):
            flat, azimuth = np.cos(pattern.elevation_rad[ring]), pattern.azimuth_rad[column]
            ray = Vector(
                flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(pattern.elevation_rad[ring])
            )
            for p in range(len(solids.kind)):
                d = pattern.origin_m[column] - solids.centre_m[p]
                c, s = np.cos(solids.yaw_rad[p]), np.sin(solids.yaw_rad[p])
                origin = Vector(c * d[0] + s * d[1], c * d[1] - s * d[0], d[2])
                course = Vector(c * ray.x + s * ray.y, c * ray.y - s * ray.x, ray.z)
                half = Vector(solids.half_m[p, 0], solids.half_m[p, 1], solids.half_m[p, 2])
                cuts = (solids.chamfer_m[p, 0], solids.chamfer_m[p, 1])
                if solids.kind[p] == 0:
                    near, far, _ = hit_box(origin, course, half, cuts)
                elif solids.kind[p] == 1:
                    near, far, _ = hit_cylinder(origin, course, half)
                else:
                    near, far, _ = hit_ellipsoid(origin, course, half)
                if 0.0 < near <= far:
                    out[column, ring] = min(out[column, ring], near)
    return out


def caster_rows(quick: bool) -> list[dict[str, Any]]:
    grid = np.zeros((600, 600), np.float32)
    terrain = Terrain(grid, np.full((600, 600), 10, np.int8), GridFrame(-150.0, -150.0, 2.0))
    pattern, materials, rows = scan_pattern(), material_table(), []
    receiver = Receiver(105.0, 1.5, 0.02, 0.05, 0.15)
    for count in (50, 200) if quick else (25, 50, 100, 200, 400):
        solids = objects(count)
        world = SceneGeometry(solids, materials, terrain)
        culled = best_ms(lambda w=world: cast(pattern, w, 1), 5 if quick else 30)
        returns = cast(pattern, world, 1)
        received = best_ms(lambda r=returns, w=world: receive(pattern, r, w, receiver, 1), 10)
        peer = best_ms(lambda s=solids: without_culling(pattern, s), 1 if quick else 3)
        rows.append(
            {
                "objects": count,
                "solids": len(solids.kind),
                "rays": len(pattern.time_s) * 32,
                "cast ms": culled,
                "receive ms": received,
                "no culling ms": peer,
                "ratio": peer / culled,
            }
        )
    return rows


def world_rows(quick: bool) -> list[dict[str, Any]]:
    rows, noise = [], np.random.SeedSequence(0)
    for place in ("urban", "residential", "motorway"):
        config = SyntheticConfig(scenes=1, seed=2, duration_s=4.0, place=place)
        scene = SyntheticDataset(config).scene("synthetic-s0002-0000")
        build = best_ms(lambda c=config: SyntheticDataset(c).scene("synthetic-s0002-0000").world, 1)
        sweep = best_ms(lambda s=scene: scan(s.world, s.rig, 2.0, noise), 3 if quick else 15)
        rows.append({"what": f"{place} scene", "build ms": build, "sweep ms": sweep})
    pairs = [best_ms(lambda i=i: training_pair(1, i), 2) for i in range(4 if quick else 24)]
    rows.append(
        {"what": "training pair (median)", "build ms": float(np.median(pairs)), "sweep ms": 0.0}
    )
    return rows


def main() -> None:
    options = arguments(__doc__ or "")
    casting, worlds = caster_rows(options.quick), world_rows(options.quick)
    report(casting, options.json)
    print()
    report(worlds, options.json.with_suffix(".worlds.json") if options.json else None)


if __name__ == "__main__":
    main()
