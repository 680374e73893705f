"""Registers components of one sweep pair: the shared engine of cluster ICP and refinement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I64, Mask
from mottrack.core.grid import BevGrid
from mottrack.flow.registration.components import grown_labels
from mottrack.flow.registration.correlation import all_starts, distance_map
from mottrack.flow.registration.kernels import MatchScene, match_components, shift_costs
from mottrack.flow.sweep_pair.prepared import SweepPair
from mottrack.lidar.point_grid import build_point_grid
from mottrack.lidar.range_image import PASSED, asked_from, seen_before


class MatchConfig(StrictModel):
    """How components are compared; lengths in metres."""

    voxel_m: float = Field(0.1, gt=0, description="one point per cube of this size is compared")
    cell_m: float = Field(0.25, gt=0, description="cell of footprints and of the correlation")
    z_scale: float = Field(
        0.5, gt=0, le=1, description="heights count less: rings sample a wall at few of them"
    )
    cap_m: float = Field(0.5, gt=0, description="farthest pair, and the cap of a distance")
    max_points: int = Field(80, ge=10, description="points of a component that are compared")
    starts: int = Field(8, ge=0, description="best displacements of the correlation to start from")
    max_speed_mps: float = Field(40.0, gt=0, description="fastest motion that is looked for")
    max_turn_radps: float = Field(0.5, ge=0, description="fastest turn; 0 registers shifts alone")
    search_above_m: float = Field(
        0.05, ge=0, description="components that rest explains better are not searched"
    )
    max_extent_m: float = Field(20.0, gt=0, description="longer components are not searched")


_SIGMA_M = 0.025
"""Noise of a registration that fits perfectly: range noise and the sampling of the surface."""
_LAID_OVER = 40
"""Points of a component that the correlation lays over the distance map."""
_MOST_STEPS = 48
"""To each side that are tried: 12 m by cells of 0.25 m, 40 m/s over 0.3 s. The work grows with its
square, so a longer way is cut into longer steps."""
_COST_SHARE = 0.4
"""Standard deviation of one coordinate of a shift, as a share of what it leaves unexplained."""


@dataclass(frozen=True, slots=True)
class Matches:
    """The best shift of each of K components."""

    shift_m: F64
    """(K, 2) planar shift of the centre from the current to the previous place."""
    turn_rad: F64
    """(K,) turn about the centre from the current to the previous heading."""
    centre_m: F64
    """(K, 2) centre of the turn in the current sweep."""
    cost_m: F64
    """(K,) mean capped distance, both ways, of the best shift."""
    significance: F64
    """(K,) standard errors by which the best shift explains the points better than rest."""
    rest_cost_m: F64
    """(K,) mean capped distance, both ways, of no shift."""
    compared: I64
    """(K,) points, of both sweeps, that the cost of rest is the mean of; hidden ones left out."""
    points: I64
    """(K,) thinned points of the component."""
    passed: I64
    """(K,) thinned points that stand where the previous sweep saw through."""
    sampled: int
    """Most points of a component that are compared."""

    @property
    def sigma_m(self) -> F64:
        """(K,) standard deviation of one coordinate of the shift."""
        return np.hypot(_SIGMA_M, _COST_SHARE * self.cost_m)


@dataclass(frozen=True, slots=True)
class Labels:
    """Components of the thinned current points."""

    of_point: I64
    """(M,) component of each thinned point, -1 for none."""
    count: int


Starts = tuple[F64, I64]
"""(S, 2) shifts in metres sorted by component, and the (K + 1,) first one of each."""
_Sorted = tuple[MatchScene, I64, I64]


class Matcher:
    """Both sweeps of a pair, thinned and indexed."""

    def __init__(self, prepared: SweepPair, config: MatchConfig) -> None:
        """Indexes the pair; the kept points are those that are compared."""
        self.config = config
        self.elapsed_s = prepared.elapsed_s
        reach_m = _reach(prepared)
        self.raster = BevGrid(-reach_m, reach_m, -reach_m, reach_m, config.cell_m)
        now, then = prepared.current_work, prepared.previous_work
        self.points_m = np.array(prepared.current.xyz_m[now.thinned(config.voxel_m)])
        self.previous_m = np.array(prepared.previous.xyz_m[then.thinned(config.voxel_m)])
        scale = np.array([1.0, 1.0, config.z_scale], np.float32)
        self._scaled_m = self.points_m * scale
        self._last: tuple[Labels, _Sorted] | None = None
        self._cells = np.column_stack(self.raster.cells(self.points_m)[:2])
        self._scene = MatchScene(
            build_point_grid(self.previous_m * scale, config.cap_m / 2, reach_m),
            build_point_grid(self._scaled_m, config.cap_m / 2, reach_m),
            asked_from(then.image, prepared.previous_T_current),
            now.image,
            np.zeros((0, 0), np.int64),
            (-reach_m, -reach_m),
            config.cell_m,
            config.z_scale,
            config.cap_m,
        )

    def match(self, labels: Labels, given: Starts | None = None, *, min_points: int = 1) -> Matches:
        """Registers each component, from rest, from the given shifts, and from a correlation.

        The correlation is left out where a start is given; components of fewer than `min_points`
        points stay at rest.
        """
        scene, order, spans = self._sorted(labels)
        points_m = np.ascontiguousarray(self._scaled_m[order])
        at_rest = np.zeros((labels.count, 2))
        rest = shift_costs(scene, (points_m, spans), at_rest, self.config.max_points)
        if given is None:
            wanted = (rest[:, 0] > self.config.search_above_m) & self._short(points_m, spans)
            given = self._correlate(self._cells[order], spans, wanted)
        limits = (
            self.config.max_points,
            self.config.max_speed_mps * self.elapsed_s,
            self.config.search_above_m,
            self.config.max_turn_radps * self.elapsed_s,
            max(min_points, 1),
        )
        result = match_components(scene, (points_m, spans), given, rest, limits)
        return Matches(
            shift_m=result[:, :2],
            turn_rad=result[:, 2],
            centre_m=result[:, 3:5],
            cost_m=result[:, 5],
            significance=result[:, 6],
            rest_cost_m=rest[:, 0],
            compared=rest[:, 1].astype(np.int64),
            points=np.diff(spans),
            passed=self._passed(order, spans),
            sampled=self.config.max_points,
        )

    def costs(self, labels: Labels, shift_m: F64) -> F64:
        """(K,) cost of one given shift (K, 2) of each component, without registration."""
        scene, order, spans = self._sorted(labels)
        points_m = np.ascontiguousarray(self._scaled_m[order])
        costs = shift_costs(scene, (points_m, spans), shift_m, self.config.max_points)
        return np.asarray(costs[:, 0])

    def _sorted(self, labels: Labels) -> _Sorted:
        """The scene with the components' footprints, points sorted by component, spans (K + 1,)."""
        if self._last is not None and self._last[0] is labels:
            return self._last[1]
        order = np.argsort(labels.of_point, kind="stable")
        order = order[np.searchsorted(labels.of_point[order], 0) :]
        spans = np.searchsorted(labels.of_point[order], np.arange(labels.count + 1))
        cells = (self._cells[:, 0], self._cells[:, 1])
        footprint = grown_labels(self.raster.shape, cells, labels.of_point)
        self._last = labels, (self._scene._replace(footprint=footprint), order, spans)
        return self._last[1]

    def _passed(self, order: I64, spans: I64) -> I64:
        states = seen_before(self._scene.previous_image, self.points_m[order])
        before = np.concatenate([[0], np.cumsum(states == PASSED)])
        return np.asarray(before[spans[1:]] - before[spans[:-1]], dtype=np.int64)

    def _short(self, points_m: F32, spans: I64) -> Mask:
        """(K,) components that are not longer than a vehicle can be."""
        if len(points_m) == 0:
            return np.zeros(len(spans) - 1, dtype=np.bool_)
        first = np.minimum(spans[:-1], len(points_m) - 1)
        low_m = np.minimum.reduceat(points_m[:, :2], first)
        high_m = np.maximum.reduceat(points_m[:, :2], first)
        short: Mask = (high_m - low_m).max(axis=1) < self.config.max_extent_m
        return short & (np.diff(spans) > 0)

    def _correlate(self, cells: I64, spans: I64, wanted: Mask) -> Starts:
        """Starts from the correlation of occupancy, in steps of a cell, or more for long gaps."""
        reach = int(np.ceil(self.config.max_speed_mps * self.elapsed_s / self.config.cell_m))
        step = max(int(np.ceil(reach / _MOST_STEPS)), 1)
        distance = distance_map(self.raster.occupancy(self.previous_m), 4.0 * step)
        limits = (int(np.ceil(reach / step)), step, self.config.starts, _LAID_OVER)
        shifts, first = all_starts(distance, cells, spans, wanted, limits)
        return np.asarray(shifts[:, ::-1] * self.config.cell_m, np.float64), first


def _reach(prepared: SweepPair) -> float:
    """Half width of a square, a whole number of metres, that holds both sweeps."""
    largest = 1.0
    for sweep in (prepared.previous, prepared.current):
        if len(sweep):
            largest = max(largest, float(np.abs(sweep.xyz_m[:, :2]).max()))
    return float(np.ceil(largest + 0.5))
