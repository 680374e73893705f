"""Milliseconds per pair of PillarFlow on a CPU, pillars and network apart, onnxruntime beside.

    python benchmarks/flow.py [--threads 4,1] [--networks small,base,paper] [--json FILE] [--quick]

The paper's grid, 400 x 400 cells of 0.25 m, and 100 000 points a sweep (`--quick`: 30 000). The
best of several runs, wall and CPU time; on a busy machine the CPU time and the ratio are what to
compare. Weights are random: they do not change the time. The network runs on the pillars of two
sweeps; both sweeps' pillars count. The paper reports 23 ms on an RTX 6000.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from _common import arguments, report

from mottrack.core.arrays import F32
from mottrack.core.grid import BevGrid
from mottrack.flow.pillarflow.calibration import Calibration
from mottrack.flow.pillarflow.decoders import preset
from mottrack.flow.pillarflow.engine import CpuEngine, EngineInput, OlderPoints, use_threads
from mottrack.flow.pillarflow.export import INPUTS, export_onnx
from mottrack.flow.pillarflow.network import PillarFlowNet
from mottrack.flow.pillarflow.pillars import CellGrid
from mottrack.flow.pillarflow.weights_file import Weights


@dataclass(frozen=True)
class Best:
    """Best of several runs."""

    wall_ms: float
    cpu_ms: float


def best_of(task: Callable[[], object], runs: int) -> Best:
    task()
    walls, cpus = [], []
    for _ in range(runs):
        wall, cpu = time.perf_counter(), time.process_time()
        task()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return Best(1e3 * min(walls), 1e3 * min(cpus))


def sweep(count: int, seed: int) -> F32:
    """Points (N,4) with the radial density of a spinning LiDAR."""
    rng = np.random.default_rng(seed)
    radius, angle = rng.exponential(18.0, count) + 3.0, rng.uniform(0, 2 * np.pi, count)
    height, reflectance = rng.uniform(0.3, 2.5, count), rng.uniform(0, 1, count)
    columns = (radius * np.cos(angle), radius * np.sin(angle), height, reflectance)
    return np.column_stack(columns).astype(np.float32)


def onnx_task(
    weights: Weights, cells: CellGrid, threads: int, images: list
) -> Callable[[], object]:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "net.onnx"
        export_onnx(weights, file, cells)
        session = onnxruntime.InferenceSession(
            str(file), options, providers=["CPUExecutionProvider"]
        )
    fed = {
        name: np.ascontiguousarray(one.numpy()) for name, one in zip(INPUTS, images, strict=False)
    }
    wanted = {one.name for one in session.get_inputs()}
    return lambda: session.run(None, {k: v for k, v in fed.items() if k in wanted})


def measure(name: str, threads: int, points: int, runs: int) -> dict[str, object]:
    use_threads(threads)
    torch.manual_seed(0)
    weights = Weights(PillarFlowNet(preset(name)).eval(), Calibration(), True)
    engine, cells = CpuEngine(weights), weights.network.cells(BevGrid())
    sweeps = [sweep(points, seed) for seed in (0, 1)]
    older = [
        OlderPoints(sweep(points, 2 + seed), 0.1 / age_s)
        for seed, age_s in enumerate(weights.network.config.older_ages_s)
    ]
    shares = np.zeros((8, cells.rows, cells.columns), np.float32)
    given = EngineInput(sweeps[0], sweeps[1], shares, tuple(older))
    images = engine.tensors(given, cells)
    pillars = best_of(lambda: engine.tensors(given, cells), runs)
    network = best_of(lambda: engine.flow_of(*images), runs)
    peer = best_of(onnx_task(weights, cells, threads, images), runs)
    return {
        "network": name,
        "threads": threads,
        "parameters": sum(p.numel() for p in weights.network.parameters()),
        "pillars wall/cpu ms": f"{pillars.wall_ms:.1f} / {pillars.cpu_ms:.1f}",
        "network wall/cpu ms": f"{network.wall_ms:.1f} / {network.cpu_ms:.1f}",
        "onnxruntime wall/cpu ms": f"{peer.wall_ms:.1f} / {peer.cpu_ms:.1f}",
        "pair wall ms": pillars.wall_ms + network.wall_ms,
        "pair cpu ms": pillars.cpu_ms + network.cpu_ms,
        "cpu, onnxruntime / mottrack": peer.cpu_ms / network.cpu_ms,
    }


def main() -> None:
    given = arguments(__doc__ or "", threads=str, networks=str)
    points, runs = (30_000, 3) if given.quick else (100_000, 10)
    rows = [
        measure(name, int(threads), points, runs)
        for name in (given.networks or "small,base,paper").split(",")
        for threads in (given.threads or "4,1").split(",")
    ]
    report(rows, given.json)


if __name__ == "__main__":
    main()
