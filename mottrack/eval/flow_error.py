"""Flow error by cell (paper, section IV-C, Table I).

A sample is an occupied cell of the BeV grid at one frame with a true velocity. Its flow in metres
is its velocity over the ground times the time between the two sweeps: the displacement of the
cell's content, ego motion removed. (The paper gives metres; a length in cells is that over the cell
size.) Every sample counts, whether the source measured it or not; one that was not measured has
flow zero, and `measured` says how many were measured.

    RMSE     sqrt(mean |f - f_true|^2), metres
    AAE      mean angle between (f, 1) and (f_true, 1), radians (Barron et al., 1994), in metres
    dynamic  cells of objects of a movable class that move; static: all other cells
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core import FlowSamples
from mottrack.core.arrays import F64, Mask
from mottrack.eval.arithmetic import SPEED_EDGES_MPS, bins
from mottrack.eval.paired import Ratio, whole

RANGE_EDGES_M = (0.0, 10.0, 20.0, 30.0, 50.0, np.inf)
"""Rings of 10 m where most cells lie; nuScenes labels cars to 50 m."""
GROSS_MPS = 1.0
"""An error beyond this is gross: walking pace, at which standing and moving are confused."""


@dataclass(frozen=True, slots=True)
class FlowError:
    """The metrics of one set of cells; NaN where there is none."""

    cells: int
    measured: float
    """Share of the cells that the source measured."""
    rmse_m: float
    aae_rad: float
    rmse_mps: float
    median_mps: float
    within_1_mps: float
    """Share of the cells whose velocity is wrong by at most 1 m/s."""


class CellErrors(NamedTuple):
    """Errors of K cells."""

    speed_mps: F64
    """(K,) |v - v_true|."""
    length_m: F64
    """(K,) |f - f_true|."""
    angle_rad: F64
    """(K,) between (f, 1) and (f_true, 1)."""


def cell_errors(samples: FlowSamples) -> CellErrors:
    """Return the errors of every cell of the samples."""
    estimate, truth = samples.estimate_mps.astype(np.float64), samples.truth_mps.astype(np.float64)
    dt_s = samples.dt_s.astype(np.float64)
    speed_mps = np.linalg.norm(estimate - truth, axis=1)
    u, v = (np.column_stack([f * dt_s[:, None], np.ones(len(samples))]) for f in (estimate, truth))
    sine = np.linalg.norm(np.cross(u, v), axis=1)
    angle_rad = np.arctan2(sine, (u * v).sum(axis=1))  # exact for small angles, unlike arccos
    return CellErrors(speed_mps, speed_mps * dt_s, angle_rad)


def flow_error(samples: FlowSamples) -> FlowError:
    """Return the metrics over all rows of the samples."""
    if not len(samples):
        return FlowError(0, *(6 * [float("nan")]))
    errors = cell_errors(samples)
    return FlowError(
        cells=len(samples),
        measured=float(samples.valid.mean()),
        rmse_m=whole(Ratio.root_mean_square([errors.length_m])),
        aae_rad=whole(Ratio.mean([errors.angle_rad])),
        rmse_mps=whole(Ratio.root_mean_square([errors.speed_mps])),
        median_mps=float(np.median(errors.speed_mps)),
        within_1_mps=float((errors.speed_mps <= GROSS_MPS).mean()),
    )


def kind_masks(samples: FlowSamples) -> dict[str, Mask]:
    """Return the masks of the dynamic, the static and all cells."""
    every = np.ones(len(samples), np.bool_)
    return {"dynamic": samples.dynamic, "static": ~samples.dynamic, "all": every}


def flow_table(parts: Iterable[FlowSamples]) -> dict[str, FlowError]:
    """Return the errors of dynamic, static and all cells, observable ones, by speed and by range.

    "observable" are the cells whose object was hit by both sweeps.
    """
    samples = FlowSamples.stacked(list(parts))
    speed_mps = np.linalg.norm(samples.truth_mps.astype(np.float64), axis=1)
    range_m = np.linalg.norm(samples.xy_m.astype(np.float64), axis=1)
    masks = {
        **kind_masks(samples),
        "observable dynamic": samples.observable & samples.dynamic,
        "observable all": samples.observable,
        "measured dynamic": samples.valid & samples.dynamic,
        "measured all": samples.valid,
        **bins(speed_mps, SPEED_EDGES_MPS, "m/s", "speed"),
        **bins(range_m, RANGE_EDGES_M, "m", "range"),
    }
    return {name: flow_error(samples.select(mask)) for name, mask in masks.items()}
