"""The dynamic occupancy grid map: time of a whole cycle, by phase, beside the same filter in numpy.

    python benchmarks/dogma.py [--json FILE] [--quick]

400 x 400 cells of 0.25 m, 32 rings, a street with moving boxes seen from a vehicle at 10 m/s. A
cycle is everything from classified returns to resampled particles, the measurement grid included;
ground removal and the read-out into the ego grid are timed apart. Wall time is the minimum over
cycles, CPU time that of all threads. The peer follows the same equations with numpy's own
generator, and its maps must agree in occupancy and in velocity.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from _common import arguments, report
from numpy.typing import NDArray

from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.flow.dogma import filter as phases
from mottrack.flow.dogma.births import MAX_DRAWS
from mottrack.flow.dogma.filter import DynamicGridFilter, FilterConfig
from mottrack.flow.dogma.measurement_grid import Masses, Returns, SensorConfig, measure, returns_of
from mottrack.flow.dogma.source import DogmaFlow
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Workers
from mottrack.flow.sweep_pair import GroundStage

CELLS, CELL_M, DT_S = 400, 0.25, 0.1
PHASES = (
    "assign",
    "update_occupancy",
    "allocate_births",
    "draw_births",
    "velocity_moments",
    "resample",
)
Grid = NDArray[np.float32]


def street(k: int) -> Sweep:
    """Sweep k: 32 rings on a road, two facades, parked and moving boxes; 1080 directions."""
    rng = np.random.default_rng(k)
    ego_x_m = 10.0 * DT_S * k
    azimuth = np.repeat(np.linspace(-np.pi, np.pi, 1080, endpoint=False), 32)
    slope = np.tile(np.tan(np.radians(np.linspace(-30.67, 10.67, 32))), 1080)
    beam = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    with np.errstate(divide="ignore"):
        reach = np.where(slope < 0, 1.8 / -slope, np.inf)
    boxes = [(x - ego_x_m, side, 2.0) for x in range(-60, 160, 9) for side in (-4.5, 4.5)]
    boxes += [(x - ego_x_m + v * DT_S * k, lane, 2.0) for x, lane, v in TRAFFIC]
    walls = [(0.0, 12.0, 400.0), (0.0, -12.0, 400.0)]
    for x, y, half in boxes + walls:
        depth = 0.9 if half < 10 else 1.0
        reach = np.minimum(reach, _slab(beam, (x, y), (half, depth), slope))
    hit = (reach < 60.0) & (rng.random(len(reach)) > 0.05)
    xy_m = beam[hit] * (reach[hit] + rng.normal(0, 0.02, hit.sum()))[:, None]
    xyz_m = np.column_stack([xy_m, 1.8 + slope[hit] * reach[hit]]).astype(np.float32)
    pose = Pose.from_yaw(0.0, [ego_x_m, 0.0, 0.0])
    origin_m = np.array([0.0, 0.0, 1.8])
    stamp_ns = int(k * DT_S * 1e9)
    return Sweep(xyz_m, np.zeros(len(xyz_m), np.float32), stamp_ns, pose, origin_m)


TRAFFIC = [(-20.0, 1.8, 14.0), (15.0, -1.8, 10.0), (40.0, 1.8, 8.0), (60.0, -1.8, -12.0)]


def _slab(
    beam: NDArray[np.float64],
    centre: tuple[float, float],
    half: tuple[float, float],
    slope: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Range at which each beam enters an upright box 1.6 m (or a facade 8 m) high."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low = (np.array(centre) - half) / beam
        high = (np.array(centre) + half) / beam
    enter = np.minimum(low, high).max(axis=1)
    leave = np.maximum(low, high).min(axis=1)
    top_m = 1.6 if half[0] < 10 else 8.0
    height_m = 1.8 + slope * enter
    met = (enter < leave) & (enter > 0) & (height_m < top_m) & (height_m > 0)
    return np.where(met, enter, np.inf)


class NumpyFilter:
    """The peer: the equations of the paper with the same rules of birth and rest, vectorised."""

    def __init__(self, config: FilterConfig) -> None:
        self.config, self.rng = config, np.random.default_rng(1)
        self.state = np.zeros((4, config.particles), np.float32)
        self.weight = np.zeros(config.particles)
        self.occupied = self.free = np.zeros((CELLS, CELLS), np.float32)
        self.window: Window | None = None

    def step(self, measured: Masses, window: Window) -> dict[str, Grid]:
        cell = self._predict(window)
        carried = np.bincount(cell, self.weight, CELLS * CELLS + 1)[:-1]
        prior = np.minimum(carried, 1).reshape(window.shape)
        rates = self.config.occupancy
        free = np.minimum(rates.free_kept * self.free, 1 - prior)
        unseen = np.clip(np.minimum(1 - self.occupied - self.free, 1 - prior - free), 0, None)
        agreed = 1 - free * measured.occupied - prior * measured.free
        unknown = 1 - prior - free
        occupied = (prior * (1 - measured.free) + unknown * measured.occupied) / agreed
        free = (free * (1 - measured.occupied) + unknown * measured.free) / agreed
        uncovered = rates.birth_unseen * unseen
        appearing = np.maximum(rates.birth * (1 - prior - unseen) + uncovered, 1e-12)
        born = occupied * appearing / (prior + appearing)
        persistent = (occupied - born).ravel()
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.append(np.where(carried > 0, persistent / carried, 0), 0)
        weight = self.weight * scale[cell]
        velocity = self._moments(cell, weight, persistent, window)
        self._resample(weight, self._births(born, uncovered / appearing))
        self.occupied, self.free = occupied, free
        return {"occupied": occupied, "persistent": persistent.reshape(window.shape), "v": velocity}

    def _predict(self, window: Window) -> NDArray[np.int64]:
        before = self.window or window
        rows, cols = before.offset_to(window)
        motion, x, y = self.config.motion, self.state[0], self.state[1]
        noise = self.rng.standard_normal(self.state.shape, np.float32)
        v = self.state[2:]
        rest = (v == 0).all(axis=0)
        self.state[:2] += v * np.float32(DT_S) + noise[:2] * motion.position_noise_m * ~rest
        x -= cols * CELL_M
        y -= rows * CELL_M
        stays = rest & (self.rng.random(len(rest)) >= motion.start)
        v += noise[2:] * np.float32(motion.velocity_noise_mps)
        v[:, stays | (np.hypot(*v) < motion.rest_below_mps)] = 0
        self.weight *= motion.survival
        row, col = np.floor(y / CELL_M).astype(int), np.floor(x / CELL_M).astype(int)
        r0, r1, c0, c1 = window.kept_from(before)
        inside = (row >= r0) & (row < r1) & (col >= c0) & (col < c1)
        self.occupied, self.free = (_moved(m, rows, cols) for m in (self.occupied, self.free))
        self.window = window
        return np.where(inside, row * CELLS + col, CELLS * CELLS)

    def _moments(
        self, cell: NDArray[np.int64], weight: Grid, mass: Grid, window: Window
    ) -> NDArray[np.float64]:
        total = np.maximum(mass, 1e-12)
        sums = [np.bincount(cell, weight * v, CELLS * CELLS + 1)[:-1] for v in self.state[2:]]
        vx, vy = (s / total for s in sums)
        for a, b, mean in ((2, 2, vx * vx), (2, 3, vx * vy), (3, 3, vy * vy)):
            product = weight * self.state[a] * self.state[b]
            np.bincount(cell, product, CELLS * CELLS + 1)[:-1] / total - mean
        return np.stack([vx, vy], axis=-1).reshape(*window.shape, 2)

    def _births(self, born: Grid, uncovered: Grid) -> tuple[Grid, NDArray[np.float64]]:
        number, prior, mass = self.config.births, self.config.birth, born.sum()
        chosen = np.searchsorted(
            np.cumsum(born), (np.arange(number) + self.rng.random()) / number * mass
        ).clip(max=CELLS * CELLS - 1)
        rest_share = prior.rest_share * uncovered.ravel()[chosen]
        state = np.zeros((4, number), np.float32)
        again = np.ones(number, np.bool_)
        for _ in range(MAX_DRAWS):
            drawn = self._born_at(chosen, rest_share)
            state[:, again] = drawn[:, again]
            again &= self.rng.random(number) < self._free_before(state)
        return state, np.full(number, mass / number)

    def _born_at(self, chosen: NDArray[np.int64], rest_share: NDArray[np.float64]) -> Grid:
        number, prior = len(chosen), self.config.birth
        place = np.stack([chosen % CELLS, chosen // CELLS]) + self.rng.random((2, number))
        slow = self.rng.random(number) < prior.slow_share
        spread = np.where(slow, prior.slow_mps, prior.fast_mps)
        spread[self.rng.random(number) < rest_share] = 0
        v = self.rng.standard_normal((2, number)) * spread
        return np.concatenate([place * CELL_M, v]).astype(np.float32)

    def _free_before(self, state: Grid) -> Grid:
        col, row = np.floor((state[:2] - DT_S * state[2:]) / CELL_M).astype(int)
        inside = (row >= 0) & (row < CELLS) & (col >= 0) & (col < CELLS)
        free = np.where(inside, self.free[row.clip(0, CELLS - 1), col.clip(0, CELLS - 1)], 0)
        return np.where((state[2:] != 0).any(axis=0), free, 0)

    def _resample(self, weight: Grid, births: tuple[Grid, NDArray[np.float64]]) -> None:
        joint = np.concatenate([weight, births[1]])
        number = self.config.particles
        teeth = (np.arange(number) + self.rng.random()) / number * joint.sum()
        chosen = np.searchsorted(np.cumsum(joint), teeth).clip(max=len(joint) - 1)
        self.state = np.concatenate([self.state, births[0]], axis=1)[:, chosen]
        self.weight = np.full(number, joint.sum() / number)


def _moved(grid: Grid, rows: int, cols: int) -> Grid:
    result = np.zeros_like(grid)
    result[: CELLS - rows, : CELLS - cols] = grid[rows:, cols:]
    return result


class Times(NamedTuple):
    """Seconds of every call of one thing."""

    wall: list[float]
    cpu: list[float]

    def best_ms(self) -> dict[str, float]:
        return {"wall ms": 1e3 * min(self.wall), "cpu ms": 1e3 * min(self.cpu)}


def timed(times: Times, function: Callable[..., Any], *arguments: Any) -> Any:
    wall, cpu = time.perf_counter(), time.process_time()
    result = function(*arguments)
    times.wall.append(time.perf_counter() - wall)
    times.cpu.append(time.process_time() - cpu)
    return result


def run_compiled(
    scans: list[tuple[Returns, Window]], particles: int, threads: int
) -> tuple[dict[str, Times], list[Any]]:
    """Times by phase, and the maps."""
    workers = Workers(threads)
    compiled = DynamicGridFilter(FilterConfig(particles=particles, births=particles // 10), workers)
    times = {name: Times([], []) for name in ("cycle", "measure", "filter", "predict", *PHASES)}
    originals = {name: getattr(phases, name) for name in PHASES}
    for name, original in originals.items():
        setattr(phases, name, lambda *a, f=original, t=times[name]: timed(t, f, *a))
    follow = compiled._follow
    compiled._follow = lambda *a: timed(times["predict"], follow, *a)
    sensor, maps = SensorConfig(), []

    def cycle(returns: Returns, window: Window) -> None:
        measured = timed(times["measure"], measure, returns, window, sensor, workers)
        maps.append(timed(times["filter"], compiled.step, measured, window, DT_S))

    for returns, window in scans:
        timed(times["cycle"], cycle, returns, window)
    for name, original in originals.items():
        setattr(phases, name, original)
    return {name: Times(t.wall[3:], t.cpu[3:]) for name, t in times.items()}, maps


def run_peer(
    scans: list[tuple[Returns, Window]], particles: int
) -> tuple[Times, list[dict[str, Grid]]]:
    peer = NumpyFilter(FilterConfig(particles=particles, births=particles // 10))
    times, maps = Times([], []), []
    for returns, window in scans:
        measured = measure(returns, window, SensorConfig(), Workers(1))
        maps.append(timed(times, peer.step, measured, window))
    return times, maps


def agreement(compiled: list[Any], peer: list[dict[str, Grid]]) -> dict[str, float]:
    """Mean differences of the last map over cells that both call occupied and persistent."""
    a, b = compiled[-1], peer[-1]
    both = (a.masses.occupied > 0.6) & (b["occupied"] > 0.6)
    both &= (a.split.persistent > 0.5) & (b["persistent"] > 0.5)
    speed = np.hypot(*(a.moments.velocity_mps - b["v"])[both].T)
    size = np.hypot(*b["v"][both].T)
    return {
        "cells": int(both.sum()),
        "mean |d m_occ|": float(np.abs(a.masses.occupied - b["occupied"]).mean()),
        "median |dv| m/s": float(np.median(speed)),
        "mean |dv| m/s": float(speed.mean()),
        "mean |v| m/s": float(size.mean()),
    }


def outside_the_cycle(sweeps: list[Sweep]) -> list[dict[str, Any]]:
    """Ground removal, and the whole of `DogmaFlow.estimate` on one thread."""
    ground, whole = Times([], []), Times([], [])
    source = DogmaFlow(DogmaFlow.Config(threads=1))
    for before, after in pairwise(sweeps):
        timed(ground, returns_of, after, GroundStage())
        timed(whole, source.estimate, before, after)
    return [
        {"what": "ground removal and classification", **Times(*(t[2:] for t in ground)).best_ms()},
        {"what": "estimate(), 3e5, 1 thread", **Times(*(t[2:] for t in whole)).best_ms()},
    ]


def main() -> None:
    options = arguments(__doc__ or "")
    sweeps = [street(k) for k in range(8 if options.quick else 12)]
    scans = []
    for sweep in sweeps:
        x_m, y_m = sweep.world_T_ego.translation_m[:2]
        window = Window.around(float(x_m), float(y_m), CELLS, CELL_M)
        scans.append((returns_of(sweep, GroundStage()), window))
    rows: list[dict[str, Any]] = []
    checks: list[dict[str, Any]] = []
    for particles in (100_000,) if options.quick else (100_000, 300_000, 1_000_000):
        peer_times, peer_maps = run_peer(scans, particles)
        peer_ms = Times(peer_times.wall[3:], peer_times.cpu[3:]).best_ms()
        for threads in (1, 4):
            times, maps = run_compiled(scans, particles, threads)
            for name, t in times.items():
                rows.append(
                    {"particles": particles, "threads": threads, "phase": name, **t.best_ms()}
                )
            ratio = peer_ms["cpu ms"] / (1e3 * min(times["filter"].cpu))
            checks.append(
                {"particles": particles, "threads": threads, "numpy / compiled, cpu": ratio}
                | agreement(maps, peer_maps)
            )
        rows.append({"particles": particles, "threads": 1, "phase": "filter, numpy", **peer_ms})
    report(rows, options.json)
    report(checks)
    report(outside_the_cycle(sweeps))


if __name__ == "__main__":
    main()
