"""Flow sources on real LiDAR that none of them was fitted to: PandaSet-002 and KITTI 0000.

    python benchmarks/flow_real.py [--rows zero,cluster_icp] [--data FOLDER] [--cell 0.5] \
        [--json FILE] [--quick]

Truth is the rigid motion of annotated cuboids since the sweep before (`_real_pairs`). The scores
are over the occupied cells of the current sweep; a cell is dynamic above 0.5 m/s; one that a
source did not measure counts as zero. `ms` is the median CPU time of one pair with all stages,
ground removal included. A network's raw field and the refined one are two rows. `--quick` takes
every fifth pair.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _common import arguments, report
from _real_pairs import Drive, cell_truth, read_kitti, read_pandaset

from mottrack.core.arrays import Floats
from mottrack.core.errors import MottrackError
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource, FrameObserver
from mottrack.core.motion import MOVING_MPS
from mottrack.experiment.settings import Settings
from mottrack.flow.cluster_icp import ClusterIcpFlow
from mottrack.flow.dogma.source import DogmaFlow
from mottrack.flow.icp import IcpConfig, IcpFlow
from mottrack.flow.pillarflow.source import (
    BinaryOgmConfig,
    BinaryOgmFlow,
    PillarFlow,
    PillarFlowConfig,
)
from mottrack.flow.zero import ZeroFlow
from mottrack.pipeline.sweep_pairs import PairConfig, SweepPairs

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
ROWS: dict[str, Callable[[BevGrid], FlowSource]] = {
    "zero": lambda grid: ZeroFlow(grid=grid),
    "icp_oracle_one": lambda grid: IcpFlow(IcpConfig(use_truth=True, starts=1), grid=grid),
    "icp_oracle_many": lambda grid: IcpFlow(IcpConfig(use_truth=True), grid=grid),
    "cluster_icp": lambda grid: ClusterIcpFlow(grid=grid),
    "dogma": lambda grid: DogmaFlow(grid=grid),
    "binary_ogm_raw": lambda grid: BinaryOgmFlow(BinaryOgmConfig(refined=False), grid=grid),
    "binary_ogm": lambda grid: BinaryOgmFlow(grid=grid),
    "pillarflow_small_raw": lambda grid: PillarFlow(
        PillarFlowConfig(weights="small", refined=False), grid=grid
    ),
    "pillarflow_small": lambda grid: PillarFlow(PillarFlowConfig(weights="small"), grid=grid),
    "pillarflow_raw": lambda grid: PillarFlow(PillarFlowConfig(refined=False), grid=grid),
    "pillarflow": lambda grid: PillarFlow(grid=grid),
}


def scores(estimate_mps: Floats, truth_mps: Floats) -> dict[str, float]:
    """Score (C, 2) estimates against (C, 2) truths, both in m/s."""
    error = np.hypot(*(estimate_mps - truth_mps).T)
    speed = np.hypot(*estimate_mps.T)
    dynamic = np.hypot(*truth_mps.T) > MOVING_MPS
    return {
        "dyn_rmse": float(np.sqrt(np.mean(error[dynamic] ** 2))),
        "dyn_median": float(np.median(error[dynamic])),
        "within_1_%": float(100 * np.mean(error[dynamic] < 1)),
        "seen_moving_%": float(100 * np.mean(speed[dynamic] > MOVING_MPS)),
        "static_rmse": float(np.sqrt(np.mean(error[~dynamic] ** 2))),
        "static>.5_%": float(100 * np.mean(speed[~dynamic] > 0.5)),
        "static>1_%": float(100 * np.mean(speed[~dynamic] > 1.0)),
    }


def run(drive: Drive, source: FlowSource, grid: BevGrid, every: int) -> dict[str, float]:
    """Score one source over a drive; one that filters over time sees every sweep."""
    estimates, truths, milliseconds = [], [], []
    pairs = SweepPairs(PairConfig.of(Settings(), source))
    for index in range(len(drive.sweeps)):
        past = pairs.push(drive.sweeps[index])
        if not past or (index % every and not source.stateful):
            continue
        if isinstance(source, FrameObserver):
            source.observe(drive.frame(index - 1))
            source.observe(drive.frame(index))
        start = time.process_time()
        field = source.estimate(past, drive.sweeps[index])
        milliseconds.append(1e3 * (time.process_time() - start))
        if index % every:
            continue
        truth = cell_truth(drive, index, grid)
        known_mps = np.where(field.valid[..., None], field.velocity_mps, 0.0)
        estimates.append(known_mps[truth.rows, truth.cols])
        truths.append(truth.velocity_mps)
    figures = scores(np.concatenate(estimates), np.concatenate(truths))
    return {**figures, "ms": float(np.median(milliseconds))}


def main() -> None:
    options = arguments(__doc__ or "", rows=str, data=Path, cell=float)
    shared = options.data or SHARED
    names = options.rows.split(",") if options.rows else list(ROWS)
    grid = BevGrid(cell_m=options.cell or 0.5)
    lines: list[dict[str, Any]] = []
    for drive in (
        read_pandaset(shared / "argoverse2" / "val" / "pandaset-002"),
        read_kitti(shared / "kitti_tracking"),
    ):
        for name in names:
            try:
                source = ROWS[name](grid)
            except MottrackError as error:
                print(f"{name} skipped: {error}")
                continue
            line = run(drive, source, grid, 5 if options.quick else 1)
            lines.append({"drive": drive.name, "source": name, **line})
    report(lines, options.json)


if __name__ == "__main__":
    main()
