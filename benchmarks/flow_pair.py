"""Flow of one labelled Argoverse 2 pair beside another method's own estimate, point by point.

    python benchmarks/flow_pair.py [--rows zero,pillarflow] [--data FOLDER] [--json FILE]

The pair and the estimate of ICP-Flow (Lin and Caesar, CVPR 2024, their demo) are stored together:
the row `ICP-Flow` is their estimate, ours are measured on the same points with the same truth.
Scored are the points of the first sweep that its authors evaluate (within 51.2 m, no ground), as
they give it: moving are those over 0.5 m/s, nearly all of three vehicles at 11 to 12.5 m/s. A
point that a source did not measure counts as resting.

Time is turned: the truth is of the first sweep, and our sources measure where the points of the
later one came from.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from _common import arguments, recorded_data, report
from flow_real import ROWS

from mottrack.core.arrays import F32, F64
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.pipeline.scene_flow import cell_velocities

FILE = Path("flow_pairs") / "argoverse2_icpflow_demo.npz"
INTERVAL_S = 0.1
"""Between the two sweeps."""
ORIGIN_M = np.array([1.35, 0.0, 1.64])
"""Optical centre of Argoverse 2's LiDARs in the vehicle's frame, which the file does not give."""
SOURCES = "zero,cluster_icp,binary_ogm,pillarflow_small,pillarflow_raw,pillarflow"
"""Without boxes (ICP with true boxes has nothing to say) and without a filter over a drive."""


def sweep(points_m: F32, stamp_ns: int) -> Sweep:
    """Make a sweep of points (N, 3) in the common frame."""
    nothing = np.zeros(len(points_m), np.float32)
    return Sweep(points_m, nothing, stamp_ns, Pose.identity(), ORIGIN_M)


def estimated_m(source: FlowSource, first_m: F32, second_m: F32) -> F64:
    """Return (N, 2) the displacement of each point of the first sweep to the second."""
    field = source.estimate((sweep(second_m, 0),), sweep(first_m, int(INTERVAL_S * 1e9)))
    return -cell_velocities(field, first_m.astype(np.float64)) * INTERVAL_S


def scores(error_m: F64, dynamic: Any, labelled: Any) -> dict[str, float]:
    """Score (N,) errors in metres over the interval, as m/s."""
    error_mps = error_m / INTERVAL_S
    groups = {"moving": dynamic, "standing": ~dynamic, "standing objects": labelled & ~dynamic}
    found: dict[str, float] = {}
    for name, mask in groups.items():
        found[f"{name}: mean"] = float(error_mps[mask].mean())
        found[f"{name}: RMSE"] = float(np.sqrt(np.mean(error_mps[mask] ** 2)))
    found["moving: within 1 m/s, %"] = float(100 * np.mean(error_mps[dynamic] <= 1.0))
    return found


def main() -> None:
    options = arguments(__doc__ or "", rows=str, data=Path)
    with np.load(recorded_data(options.data) / FILE) as pair:
        first_m, second_m, near = pair["points0"], pair["points1"], pair["near0"]
        truth_m, peer_m = pair["flow0_m"][near], pair["peer_flow0_m"][near]
        dynamic, labelled = pair["dynamic0"][near], pair["class0"][near] >= 0
    error_m = np.linalg.norm((peer_m - truth_m).astype(np.float64), axis=1)
    lines = [{"method": "ICP-Flow", **scores(error_m, dynamic, labelled), "CPU ms": float("nan")}]
    grid = BevGrid(x_min_m=-52.0, x_max_m=52.0, y_min_m=-52.0, y_max_m=52.0, cell_m=0.5)
    for name in (options.rows or SOURCES).split(","):
        source = ROWS[name](grid)
        estimated_m(source, first_m, second_m)  # loads and compiles
        source.reset()
        start = time.process_time()
        said_m = np.zeros((int(near.sum()), 3))
        said_m[:, :2] = estimated_m(source, first_m, second_m)[near]
        milliseconds = 1e3 * (time.process_time() - start)
        error_m = np.linalg.norm(said_m - truth_m, axis=1)
        lines.append({"method": name, **scores(error_m, dynamic, labelled), "CPU ms": milliseconds})
    report(lines, options.json)


if __name__ == "__main__":
    main()
