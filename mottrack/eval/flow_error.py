"""Flow error by cell (paper, section IV-C, Table I).

A sample is an occupied cell of the BeV grid at one frame with a true velocity. Its flow in metres
is its velocity over the ground times the time between the two sweeps: the displacement of the
cell's content, ego motion removed. (The paper gives metres; a length in cells is that over the cell
size.) Every sample counts, whether the source measured it or not; one that was not measured has
flow zero, and `measured` says how many were measured.

    RMSE     sqrt(mean |f - f_true|^2), metres
    AAE      mean angle between (f, 1) and (f_true, 1), radians (Barron et al., 1994), in metres
    dynamic  cells of objects above 0.5 m/s; static: all other cells
    movable  cells of objects of the tracked classes, parked ones included: what the paper's Table I
             calls dynamic
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core import FlowSamples
from mottrack.core.arrays import F64, Mask
from mottrack.eval.arithmetic import SPEED_EDGES_MPS, bins
from mottrack.eval.streams import Distribution, RunningSum, Wanted

RANGE_EDGES_M = (0.0, 10.0, 20.0, 30.0, 50.0, np.inf)
"""Rings of 10 m where most cells lie; nuScenes labels cars to 50 m."""
GROSS_MPS = 1.0
"""An error beyond this is gross: walking pace, at which standing and moving are confused."""


# what a scene has of which no flow was sampled
NO_SAMPLES = FlowSamples.empty()


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

    def select(self, mask: Mask) -> CellErrors:
        """Return the errors of the cells that a mask picks."""
        return CellErrors(*(column[mask] for column in self))


class CellSums(NamedTuple):
    """Sums over the cells of a scene."""

    cells: float = 0.0
    speed_squares: float = 0.0
    """m²/s²"""
    length_squares: float = 0.0
    """m²"""
    angles: float = 0.0
    """Radians."""

    @classmethod
    def of(cls, errors: CellErrors) -> CellSums:
        """Add up the errors of a scene."""
        return cls(
            cells=float(len(errors.speed_mps)),
            speed_squares=float((errors.speed_mps**2).sum()),
            length_squares=float((errors.length_m**2).sum()),
            angles=float(errors.angle_rad.sum()),
        )


def cell_errors(samples: FlowSamples) -> CellErrors:
    """Return the errors of every cell of the samples."""
    estimate, truth = samples.estimate_mps.astype(np.float64), samples.truth_mps.astype(np.float64)
    dt_s = samples.dt_s.astype(np.float64)
    u, v = (np.column_stack([f * dt_s[:, None], np.ones(len(samples))]) for f in (estimate, truth))
    sine = np.linalg.norm(np.cross(u, v), axis=1)
    angle_rad = np.arctan2(sine, (u * v).sum(axis=1))  # exact for small angles, unlike arccos
    speed_mps = _speed_errors(samples)
    return CellErrors(speed_mps, speed_mps * dt_s, angle_rad)


def _speed_errors(samples: FlowSamples) -> F64:
    error = samples.estimate_mps.astype(np.float64) - samples.truth_mps.astype(np.float64)
    length: F64 = np.linalg.norm(error, axis=1)
    return length


def kind_masks(samples: FlowSamples) -> dict[str, Mask]:
    """Return the masks of the dynamic, the movable, the static and all cells."""
    return {
        "dynamic": samples.dynamic,
        "movable": samples.movable,
        "static": ~samples.dynamic,
        "all": np.ones(len(samples), np.bool_),
    }


def _row_masks(samples: FlowSamples) -> dict[str, Mask]:
    """Return the mask of the cells of every row of the table."""
    speed_mps = np.linalg.norm(samples.truth_mps.astype(np.float64), axis=1)
    range_m = np.linalg.norm(samples.xy_m.astype(np.float64), axis=1)
    return {
        **kind_masks(samples),
        "observable dynamic": samples.observable & samples.dynamic,
        "observable all": samples.observable,
        "measured dynamic": samples.valid & samples.dynamic,
        "measured all": samples.valid,
        **bins(speed_mps, SPEED_EDGES_MPS, "m/s", "speed"),
        **bins(range_m, RANGE_EDGES_M, "m", "range"),
    }


class FlowTable:
    """Flow errors of many scenes of which none is held: every scene is given twice.

    Rows are dynamic, movable, static and all cells, those that are observable (their object was hit
    by both sweeps) or measured, and cells by speed and by range.
    """

    def __init__(self) -> None:
        self._rows: dict[str, _Row] = {}
        self.sums: dict[str, list[CellSums]] = {kind: [] for kind in kind_masks(NO_SAMPLES)}
        """Kind of cell to the sums of each scene, after the second pass."""

    def count(self, samples: FlowSamples) -> None:
        """Take the next scene in the first pass."""
        errors_mps = _speed_errors(samples)
        for name, mask in _row_masks(samples).items():
            self._rows.setdefault(name, _Row()).speed_mps.count(errors_mps[mask])

    def add(self, samples: FlowSamples) -> None:
        """Take the next scene in the second pass."""
        errors = cell_errors(samples)
        for name, mask in _row_masks(samples).items():
            own = errors.select(mask)
            self._rows[name].add(own, samples.valid[mask])
            if name in self.sums:
                self.sums[name].append(CellSums.of(own))

    @property
    def sampled(self) -> bool:
        """Whether any cell was given."""
        return "all" in self._rows and self._rows["all"].speed_mps.size > 0

    def rows(self) -> dict[str, FlowError]:
        """Return the table, after the second pass."""
        return {name: row.error() for name, row in self._rows.items()}


class _Row:
    """One row of the table."""

    def __init__(self) -> None:
        self.speed_mps = Distribution(Wanted(quantiles=(0.5,)))
        self._sums: _RowSums | None = None
        self._measured = self._within = 0

    def add(self, errors: CellErrors, measured: Mask) -> None:
        """Take cells in the second pass."""
        if self._sums is None:
            cells = self.speed_mps.size
            self._sums = _RowSums(RunningSum(cells), RunningSum(cells), RunningSum(cells))
        self.speed_mps.add(errors.speed_mps)
        self._sums.speed_squares.add(errors.speed_mps**2)
        self._sums.length_squares.add(errors.length_m**2)
        self._sums.angles.add(errors.angle_rad)
        self._measured += int(np.count_nonzero(measured))
        self._within += int(np.count_nonzero(errors.speed_mps <= GROSS_MPS))

    def error(self) -> FlowError:
        """Return the metrics; NaN without cells."""
        cells = self.speed_mps.size
        if self._sums is None or not cells:
            return FlowError(0, *(6 * [float("nan")]))
        return FlowError(
            cells=cells,
            measured=self._measured / cells,
            rmse_m=float(np.sqrt(self._sums.length_squares.total / cells)),
            aae_rad=self._sums.angles.total / cells,
            rmse_mps=float(np.sqrt(self._sums.speed_squares.total / cells)),
            median_mps=self.speed_mps.median,
            within_1_mps=self._within / cells,
        )


class _RowSums(NamedTuple):
    """Sums over all cells of a row."""

    speed_squares: RunningSum
    length_squares: RunningSum
    angles: RunningSum


def flow_table(parts: Sequence[FlowSamples]) -> dict[str, FlowError]:
    """Return the errors by kind of cell, see `FlowTable`; the parts are read twice."""
    table = FlowTable()
    for samples in parts:
        table.count(samples)
    for samples in parts:
        table.add(samples)
    return table.rows()
