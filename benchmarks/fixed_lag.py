"""Fixed-lag smoothing of 300 tracks in real time, beside GTSAM's own smoother.

CPU milliseconds a frame on one core. "engine" is the elimination alone with the newest mean and
covariance of every track, "tracker" the whole step from objects to tracks with association, merge
and split, and robust weights. The peer is one `gtsam.IncrementalFixedLagSmoother` per track with
the same whitened factors, timed in the same run on the first frames. Memory is the resident size
over a long run.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gtsam
import numpy as np
from _common import arguments, report
from numpy.typing import NDArray

from mottrack.core import Objects, VelocityMeasurement
from mottrack.trackers.fixed_lag import FixedLagConfig, FixedLagTracker
from mottrack.trackers.fixed_lag.config import MotionModelConfig
from mottrack.trackers.fixed_lag.gtsam_engine import GtsamEngine
from mottrack.trackers.fixed_lag.nodes import NodeBatch, WhitenedRows, whiten
from mottrack.trackers.fixed_lag.numpy_engine import NumpyEngine

MODEL = MotionModelConfig()


class World:
    """Tracks that are born and die (5 % a frame), are missed (15 %), at irregular steps."""

    def __init__(self, tracks: int, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.state = np.zeros((tracks, 4))
        self.alive = np.zeros(tracks, np.bool_)
        self.stamp_ns = 10**9

    def step(self) -> tuple[NodeBatch, list[int]]:
        """The next frame's nodes, and the slots whose tracks have ended."""
        rng, count = self.rng, len(self.alive)
        dt_ns = int(rng.uniform(0.07, 0.13) * 1e9)
        self.stamp_ns += dt_ns
        self.state[:, :2] += self.state[:, 2:] * dt_ns * 1e-9
        dies = self.alive & (rng.random(count) < 0.05)
        born = dies | ~self.alive
        fresh = np.column_stack([rng.uniform(-80, 80, (count, 2)), rng.normal(0, 8, (count, 2))])
        self.state[born] = fresh[born]
        seen = rng.random(count) < 0.85
        birth = born & seen
        self.alive = (self.alive & ~dies) | birth
        rows = np.flatnonzero(seen)
        batch = NodeBatch(
            stamp_ns=self.stamp_ns,
            slot=rows,
            birth=birth[rows],
            position_m=self.state[rows, :2] + 0.2 * rng.normal(size=(len(rows), 2)),
            position_covariance_m2=np.tile(0.04 * np.eye(2), (len(rows), 1, 1)),
            velocity_mps=self.state[rows, 2:] + 0.3 * rng.normal(size=(len(rows), 2)),
            velocity_covariance_m2ps2=np.tile(0.1 * np.eye(2), (len(rows), 1, 1)),
            has_velocity=rng.random(len(rows)) < 0.8,
            extent_m=np.full(len(rows), 4.5),
            weight=np.ones((len(rows), 2)),
            innovation=np.zeros((len(rows), 2)),
        )
        return batch, np.flatnonzero(dies).tolist()


class OwnSmoothers:
    """One incremental smoother per track, with the same whitened rows as linear factors."""

    def __init__(self, lag_s: float) -> None:
        self.lag_s = lag_s
        self.params = gtsam.ISAM2Params()
        self.params.findUnusedFactorSlots = True
        self.smoothers: dict[int, Any] = {}
        self.counts: dict[int, int] = {}
        self.last_ns: dict[int, int] = {}

    def step(self, batch: NodeBatch, ended: list[int]) -> None:
        for slot in ended:
            self.smoothers.pop(slot, None)
        dt_s = np.array(
            [
                (batch.stamp_ns - self.last_ns.get(s, batch.stamp_ns)) * 1e-9
                for s in batch.slot.tolist()
            ]
        )
        rows = whiten(batch, np.zeros((len(batch), 2)), dt_s, MODEL)
        for row, slot in enumerate(batch.slot.tolist()):
            self._update(batch, rows, row, slot)

    def _update(self, batch: NodeBatch, rows: WhitenedRows, row: int, slot: int) -> None:
        count = rows.count[row]
        if batch.birth[row]:
            self.smoothers[slot] = gtsam.IncrementalFixedLagSmoother(self.lag_s, self.params)
            self.counts[slot] = 0
            factor = gtsam.JacobianFactor(
                0,
                rows.current[row, :count],
                rows.target[row, :count],
                gtsam.noiseModel.Unit.Create(int(count)),
            )
        else:
            key = self.counts[slot]
            factor = gtsam.JacobianFactor(
                key - 1,
                rows.previous[row, :count],
                key,
                rows.current[row, :count],
                rows.target[row, :count],
                gtsam.noiseModel.Unit.Create(int(count)),
            )
        key = self.counts[slot]
        zero = gtsam.Values()
        zero.insert(key, np.zeros(6))
        linearised_at = gtsam.Values(zero)
        if key:
            linearised_at.insert(key - 1, np.zeros(6))
        graph = gtsam.NonlinearFactorGraph()
        graph.add(gtsam.LinearContainerFactor(factor, linearised_at))
        smoother = self.smoothers[slot]
        smoother.update(graph, zero, {key: batch.stamp_ns * 1e-9})
        smoother.calculateEstimateVector(key)
        smoother.marginalCovariance(key)
        self.counts[slot] = key + 1
        self.last_ns[slot] = batch.stamp_ns


def timed(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return (time.process_time() - start) * 1e3


def resident_mb() -> float:
    if sys.platform != "linux":
        return float("nan")
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def engine_times(
    engine: GtsamEngine | NumpyEngine, frames: int, tracks: int, start_ns: int = 10**9
) -> NDArray[np.float64]:
    world, times = World(tracks), []
    world.stamp_ns = start_ns
    for _ in range(frames):
        batch, ended = world.step()

        def work(batch: NodeBatch = batch, ended: list[int] = ended) -> None:
            for slot in ended:
                engine.release(slot)
            engine.step(batch)
            engine.newest(batch.slot)

        times.append(timed(work))
    return np.array(times)


def peer_times(lag_s: float, frames: int, tracks: int) -> NDArray[np.float64]:
    world, smoothers, times = World(tracks), OwnSmoothers(lag_s), []
    for _ in range(frames):
        batch, ended = world.step()
        times.append(timed(lambda batch=batch, ended=ended: smoothers.step(batch, ended)))
    return np.array(times)


def clusters_of(batch: NodeBatch) -> Objects:
    """The same measurements as clusters of 2 m by 1 m."""
    count = len(batch)
    corners = np.array([[-1, -0.5], [1, -0.5], [1, 0.5], [-1, 0.5]])
    return Objects(
        stamp_ns=batch.stamp_ns,
        centre_m=np.column_stack([batch.position_m, np.ones(count)]),
        size_m=np.tile([2.0, 1.0, 1.5], (count, 1)),
        yaw_rad=np.zeros(count),
        label=np.full(count, "generic"),
        score=np.ones(count),
        velocity=VelocityMeasurement(
            batch.velocity_mps, batch.velocity_covariance_m2ps2, batch.has_velocity
        ),
        hull=tuple(corners + centre for centre in batch.position_m),
        position_covariance_m2=batch.position_covariance_m2,
    )


def tracker_times(lag_s: float, frames: int, tracks: int) -> NDArray[np.float64]:
    world, times = World(tracks), []
    tracker = FixedLagTracker(FixedLagConfig(lag_s=lag_s))
    for _ in range(frames):
        objects = clusters_of(world.step()[0])
        times.append(timed(lambda objects=objects: tracker.step(objects.stamp_ns, objects)))
    return np.array(times)


def row(what: str, lag_s: float, times: NDArray[np.float64], peer_ms: float) -> dict[str, object]:
    settled = times[min(20, len(times) // 3) :]
    mean = float(settled.mean())
    return {
        "what": what,
        "lag_s": lag_s,
        "frames": len(settled),
        "mean_ms": mean,
        "p50_ms": float(np.percentile(settled, 50)),
        "p99_ms": float(np.percentile(settled, 99)),
        "peer_over_this": peer_ms / mean,
    }


def main() -> None:
    options = arguments(__doc__ or "", tracks=int, frames=int)
    tracks = options.tracks or 300
    frames = options.frames or (60 if options.quick else 300)
    lines: list[dict[str, object]] = []
    for lag_s in (1.0, 2.0):
        lag_ns = round(lag_s * 1e9)
        peer = peer_times(lag_s, 36 if options.quick else 80, tracks)
        peer_ms = float(peer[min(20, len(peer) // 3) :].mean())
        lines.append(row("IncrementalFixedLagSmoother per track", lag_s, peer, peer_ms))
        for name, engine in (
            ("engine gtsam", GtsamEngine(MODEL, lag_ns)),
            ("engine gtsam, three factors", GtsamEngine(MODEL, lag_ns, separate_factors=True)),
            ("engine numpy", NumpyEngine(MODEL, lag_ns)),
        ):
            lines.append(row(name, lag_s, engine_times(engine, frames, tracks), peer_ms))
        lines.append(row("tracker gtsam", lag_s, tracker_times(lag_s, frames, tracks), peer_ms))
    report(lines, options.json)
    long_run = 500 if options.quick else 5000
    engine = GtsamEngine(MODEL, 10**9)
    engine_times(engine, 100, tracks)
    for slot in engine.live().tolist():
        engine.release(slot)
    before = resident_mb()
    engine_times(engine, long_run, tracks, start_ns=10**12)
    print(f"memory over {long_run} frames: {before:.1f} -> {resident_mb():.1f} MB")


if __name__ == "__main__":
    main()
