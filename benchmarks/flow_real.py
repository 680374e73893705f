"""Flow sources on real LiDAR that none of them was fitted to: PandaSet 002, 002b and KITTI 0000.

    python benchmarks/flow_real.py [--rows zero,cluster_icp] [--data FOLDER] [--cell 0.5] \
        [--json FILE] [--quick]

Truth is the rigid motion of annotated cuboids, their velocities fitted over time (`_real_pairs`).
The scores are over the occupied cells of the current sweep; a cell is dynamic above 0.5 m/s; one
that a source did not measure counts as zero. Static cells within 1.5 m of a moving box are left
out. `d2/2` is the mean of e' C^-1 e / 2 over the measured cells that are dynamic in truth and
estimate, 1 where the covariance C is right, and `2 sigma_%` the share of them within its second
contour, 86 % of a Gaussian. `ms` is the median CPU time of one frame with all stages, ground
removal included. A network's raw field and the refined one are two rows. `--quick` takes every
fifth frame.

The second table has the groups: by true speed, pedestrians and cyclists, objects with under 30
points, cells that have entered the grid since the sweep before, the vehicle at rest or driving,
and the mean over tracks, in which a large object counts as much as a small one.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from _common import arguments, recorded_data, report
from _real_pairs import (
    EGO_RESTS_BELOW_MPS,
    CellTruth,
    Drive,
    cell_truth,
    read_kitti,
    read_pandaset,
)

from mottrack.core.arrays import F64, Mask
from mottrack.core.errors import MottrackError
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource, FrameObserver
from mottrack.core.motion import MOVING_MPS, FlowField
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

ROWS: dict[str, Callable[[BevGrid], FlowSource]] = {
    "zero": lambda grid: ZeroFlow(grid=grid),
    "icp_oracle_one": lambda grid: IcpFlow(IcpConfig(use_truth=True, starts=1), grid=grid),
    "icp_oracle_many": lambda grid: IcpFlow(IcpConfig(use_truth=True), grid=grid),
    "icp_oracle": lambda grid: IcpFlow(IcpConfig(use_truth=True, search="everywhere"), grid=grid),
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
SPEED_EDGES_MPS = (MOVING_MPS, 2.0, 5.0, 10.0, np.inf)
"""Walking and creeping, then town traffic in three steps."""
FEW_POINTS = 30
"""Below, an object's shape does not show where it was."""
VULNERABLE = ("pedestrian", "cyclist", "bicycle", "motorcycle")
"""Classes of people outside of cars."""
SECOND_CONTOUR = 4.0
"""Squared Mahalanobis distance of the second contour."""


class Cells:
    """The cells of a drive with the estimates of one source."""

    def __init__(self) -> None:
        self._parts: list[dict[str, Any]] = []

    def add(self, truth: CellTruth, field: FlowField, *, ego_rests: bool) -> None:
        """Take the cells of one frame."""
        valid = field.valid[truth.rows, truth.cols]
        estimate = np.where(valid[:, None], field.velocity_mps[truth.rows, truth.cols], 0.0)
        covariance = field.covariance_m2ps2[truth.rows, truth.cols].astype(np.float64)
        error = estimate - truth.velocity_mps
        whole = covariance + 1e-9 * np.eye(2)  # no inverse of a source without covariance
        self._parts.append(
            {
                "error": np.hypot(*error.T),
                "speed": np.hypot(*estimate.T),
                "true_speed": np.hypot(*truth.velocity_mps.T),
                "squared": np.einsum("ca,cab,cb->c", error, np.linalg.inv(whole), error),
                "stated": covariance[:, 0, 0] + covariance[:, 1, 1] > 0,
                "valid": valid,
                "rim": truth.rim,
                "entering": truth.entering,
                "points": truth.points,
                "label": truth.label,
                "track": truth.track,
                "ego_rests": np.full(len(valid), ego_rests),
            }
        )

    def __getitem__(self, name: str) -> Any:
        return np.concatenate([part[name] for part in self._parts])

    def scores(self) -> dict[str, float]:
        """Return the figures over all cells."""
        error, speed, valid = self["error"], self["speed"], self["valid"]
        dynamic = self["true_speed"] > MOVING_MPS
        static = ~dynamic & ~self["rim"]
        stated = dynamic & valid & (speed > MOVING_MPS) & self["stated"]
        squared = self["squared"][stated]
        return {
            "dyn_rmse": root_mean_square(error[dynamic]),
            "dyn_median": float(np.median(error[dynamic])),
            "within_1_%": percent(error[dynamic] < 1),
            "seen_moving_%": percent(speed[dynamic] > MOVING_MPS),
            "valid_%": percent(valid[dynamic]),
            "d2/2": float(np.mean(squared) / 2) if len(squared) else np.nan,
            "2 sigma_%": percent(squared < SECOND_CONTOUR),
            "static_rmse": root_mean_square(speed[static]),
            "static>.5_%": percent(speed[static] > 0.5),
            "static>1_%": percent(speed[static] > 1.0),
            "static_valid_%": percent(valid[static]),
        }

    def groups(self) -> Iterator[dict[str, Any]]:
        """Yield the figures of each group of dynamic cells that there are."""
        dynamic, track = self["true_speed"] > MOVING_MPS, self["track"]
        for name, mask in self._masks().items():
            chosen = dynamic & mask
            if chosen.any():
                tracks, cells = len(np.unique(track[chosen])), int(chosen.sum())
                yield {"group": name, "tracks": tracks, "cells": cells, **self._figures(chosen)}
        each = [self._figures(dynamic & (track == one)) for one in np.unique(track[dynamic])]
        mean = {name: float(np.mean([one[name] for one in each])) for name in each[0]}
        count = int(dynamic.sum())
        yield {"group": "mean of tracks", "tracks": len(each), "cells": count, **mean}

    def _figures(self, chosen: Mask) -> dict[str, float]:
        error = self["error"][chosen]
        return {
            "rmse": root_mean_square(error),
            "median": float(np.median(error)),
            "within_1_%": percent(error < 1),
            "seen_moving_%": percent(self["speed"][chosen] > MOVING_MPS),
            "valid_%": percent(self["valid"][chosen]),
        }

    def _masks(self) -> dict[str, Mask]:
        true_speed = self["true_speed"]
        speeds = {
            f"{low:g}-{high:g} m/s": (true_speed >= low) & (true_speed < high)
            for low, high in pairwise(SPEED_EDGES_MPS)
        }
        label, few, enters = self["label"], self["points"] < FEW_POINTS, self["entering"]
        return {
            **speeds,
            "pedestrian": label == "pedestrian",
            "people": np.isin(label, VULNERABLE),
            f"< {FEW_POINTS} points": few,
            "entering": enters,
            "neither": ~few & ~enters,
            "ego rests": self["ego_rests"],
            "ego drives": ~self["ego_rests"],
        }


def root_mean_square(values: F64) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def percent(mask: Mask) -> float:
    return float(100 * np.mean(mask)) if len(mask) else np.nan


def run(drive: Drive, source: FlowSource, grid: BevGrid, every: int) -> tuple[Cells, float]:
    """Score one source over a drive; one that filters over time sees every sweep.

    Returns the cells and the median CPU time of a frame in milliseconds.
    """
    pairs, cells, milliseconds = SweepPairs(PairConfig.of(Settings(), source)), Cells(), []
    for index, sweep in enumerate(drive.sweeps):
        if isinstance(source, FrameObserver):
            source.observe(drive.frame(index))
        past = pairs.push(sweep)
        if not past or (index % every and not source.stateful):
            continue
        start = time.process_time()
        field = source.estimate(past, sweep)
        milliseconds.append(1e3 * (time.process_time() - start))
        if index % every == 0:
            rests = drive.ego_speed_mps(index) < EGO_RESTS_BELOW_MPS
            cells.add(cell_truth(drive, index, grid), field, ego_rests=rests)
    return cells, float(np.median(milliseconds))


def main() -> None:
    options = arguments(__doc__ or "", rows=str, data=Path, cell=float)
    shared = recorded_data(options.data)
    names = options.rows.split(",") if options.rows else list(ROWS)
    grid = BevGrid(cell_m=options.cell or 0.5)
    lines: list[dict[str, Any]] = []
    groups: list[dict[str, Any]] = []
    for drive in (
        read_pandaset(shared / "argoverse2" / "val" / "pandaset-002"),
        read_pandaset(shared / "argoverse2_driving" / "val" / "pandaset-002b"),
        read_kitti(shared / "kitti_tracking"),
    ):
        for name in names:
            try:
                source = ROWS[name](grid)
            except MottrackError as error:
                print(f"{name} skipped: {error}")
                continue
            cells, ms = run(drive, source, grid, 5 if options.quick else 1)
            head = {"drive": drive.name, "source": name}
            lines.append({**head, **cells.scores(), "ms": ms})
            groups += [{**head, **group} for group in cells.groups()]
    report(lines)
    print()
    report(groups)
    if options.json is not None:
        options.json.write_text(json.dumps({"all": lines, "groups": groups}, indent=2) + "\n")


if __name__ == "__main__":
    main()
