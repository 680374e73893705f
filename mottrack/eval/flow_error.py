"""Flow error by cell (paper, section IV-C, Table I).

A sample is an occupied cell of the BeV grid at one frame with a true velocity. Its flow in metres
is its velocity over the ground times the time between the two sweeps: the way the cell's content
moved, ego motion removed. (The paper gives metres; a length in cells is that over the cell size.)
Every sample counts, whether the source measured it or not; one that was not measured has flow zero,
and `measured` says how many were measured.

    RMSE     sqrt(mean |f - f_true|^2), metres
    AAE      mean angle between (f, 1) and (f_true, 1), radians (Barron et al., 1994), in metres
    dynamic  cells of objects of a movable class that move; static: all other cells
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mottrack.core import FlowSamples
from mottrack.core.arrays import F64, Mask

SPEED_EDGES_MPS = (0.0, 0.2, 1.0, 3.0, 8.0, np.inf)
RANGE_EDGES_M = (0.0, 10.0, 20.0, 30.0, 50.0, np.inf)


@dataclass(frozen=True, slots=True)
class FlowError:
    """The figures of one set of cells; NaN where there is none."""

    cells: int
    measured: float
    """Share of the cells that the source measured."""
    rmse_m: float
    aae_rad: float
    rmse_mps: float
    median_mps: float
    within_1_mps: float
    """Share of the cells whose velocity is wrong by at most 1 m/s."""


def flow_error(samples: FlowSamples) -> FlowError:
    """The figures over all rows of the samples."""
    if not len(samples):
        return FlowError(0, *(6 * [float("nan")]))
    estimate = samples.estimate_mps.astype(np.float64)
    truth = samples.truth_mps.astype(np.float64)
    dt_s = samples.dt_s.astype(np.float64)
    speed_error = np.linalg.norm(estimate - truth, axis=1)
    return FlowError(
        cells=len(samples),
        measured=float(samples.valid.mean()),
        rmse_m=_root_mean_square(speed_error * dt_s),
        aae_rad=float(angular_error(samples).mean()),
        rmse_mps=_root_mean_square(speed_error),
        median_mps=float(np.median(speed_error)),
        within_1_mps=float((speed_error <= 1.0).mean()),
    )


def flow_table(parts: Iterable[FlowSamples]) -> dict[str, FlowError]:
    """Figures for dynamic, static and all cells, observable ones, by true speed and by range.

    "observable" are the cells whose object was hit by both sweeps.
    """
    samples = FlowSamples.stacked(list(parts))
    speed = np.linalg.norm(samples.truth_mps.astype(np.float64), axis=1)
    distance = np.linalg.norm(samples.xy_m.astype(np.float64), axis=1)
    seen = samples.observable
    masks = {
        "dynamic": samples.dynamic,
        "static": ~samples.dynamic,
        "all": np.ones(len(samples), np.bool_),
        "observable dynamic": seen & samples.dynamic,
        "observable all": seen,
        "measured dynamic": samples.valid & samples.dynamic,
        "measured all": samples.valid,
    }
    masks |= _buckets("speed", "m/s", speed, SPEED_EDGES_MPS)
    masks |= _buckets("range", "m", distance, RANGE_EDGES_M)
    return {name: flow_error(samples.select(mask)) for name, mask in masks.items()}


def _buckets(name: str, unit: str, value: F64, edges: tuple[float, ...]) -> dict[str, Mask]:
    return {
        f"{name} [{low:g}, {high:g}) {unit}": (value >= low) & (value < high)
        for low, high in pairwise(edges)
    }


def _root_mean_square(value: F64) -> float:
    return float(np.sqrt(np.mean(value**2)))


def angular_error(samples: FlowSamples) -> F64:
    """(K,) angle between (f, 1) and (f_true, 1); by atan2: small angles keep their digits."""
    dt_s = samples.dt_s.astype(np.float64)[:, None]
    u = np.column_stack([samples.estimate_mps * dt_s, np.ones(len(samples))])
    v = np.column_stack([samples.truth_mps * dt_s, np.ones(len(samples))])
    across = np.linalg.norm(np.cross(u, v), axis=1)
    angle: F64 = np.arctan2(across, (u * v).sum(axis=1))
    return angle
