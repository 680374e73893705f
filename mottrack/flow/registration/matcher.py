"""Registration of the components of a sweep pair, for cluster ICP and for refinement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I64, Mask
from mottrack.core.grid import BevGrid
from mottrack.flow.registration.components import footprints
from mottrack.flow.registration.correlation import SearchGrid, correlate_all, distance_map
from mottrack.flow.registration.kernels import (
    Components,
    MatchScene,
    SearchLimits,
    Starts,
    match_components,
    shift_costs,
)
from mottrack.flow.sweep_pair import PastSweep, SweepPair
from mottrack.lidar.point_grid import build_point_grid
from mottrack.lidar.visibility import FREE, queried_from, states_of


class CompareConfig(StrictModel):
    """How components are compared; lengths in metres."""

    voxel_m: float = Field(0.1, gt=0, description="one point per cube of this size is compared")
    cell_m: float = Field(0.25, gt=0, description="cell of footprints and of the correlation")
    z_scale: float = Field(
        0.5, gt=0, le=1, description="weight of heights: rings sample a wall at few of them"
    )
    truncation_m: float = Field(
        0.5, gt=0, description="truncation distance of the cost, and the farthest pair"
    )
    max_points: int = Field(50, ge=10, description="points of a component that are compared")
    max_turn_radps: float = Field(
        0.5, ge=0, description="fastest rotation; 0 registers shifts alone"
    )


class MatchConfig(CompareConfig):
    """How components are compared and searched; lengths in metres."""

    max_points: int = Field(80, ge=10, description="points of a component that are compared")
    starts: int = Field(8, ge=0, description="best displacements of the correlation to start from")
    max_speed_mps: float = Field(
        40.0, gt=0, description="fastest motion: it sets the search radius"
    )
    search_above_m: float = Field(
        0.05, ge=0, description="components with a lower zero-motion cost are not searched"
    )
    max_extent_m: float = Field(20.0, gt=0, description="longer components are not searched")


_SIGMA_M = 0.025
"""Noise of a registration that fits perfectly: range noise and the sampling of the surface."""
_COST_SHARE = 0.4
"""Standard deviation of one coordinate of a shift, as a share of its remaining cost."""
_CORRELATED_POINTS = 40
"""Points of a component that the correlation compares with the distance map."""
_MAX_STEPS = 48
"""Search radius in steps: 12 m by cells of 0.25 m, 40 m/s over 0.3 s. The work grows with its
square, so a longer displacement is searched in longer steps."""
_TRUNCATION_STEPS = 4.0
"""Truncation distance of the distance map: farther cells are no evidence of a nearby match."""
_RANGE_TOLERANCE_M = 0.5
"""How far before the returns around it a point must lie to be in free space."""


@dataclass(frozen=True, slots=True)
class Matches:
    """The best motion of each of K components."""

    shift_m: F64
    """(K, 2) planar shift of the centre from the current to the previous place."""
    turn_rad: F64
    """(K,) rotation about the centre from the current to the previous heading."""
    centre_m: F64
    """(K, 2) centre of the rotation in the current sweep."""
    cost_m: F64
    """(K,) mean truncated distance, in both directions, of the best motion."""
    significance: F64
    """(K,) standard errors by which the best motion explains the points better than none."""
    zero_motion_cost_m: F64
    """(K,) mean truncated distance, in both directions, of no motion."""
    compared: I64
    """(K,) points, of both sweeps, in the zero-motion cost; unseen ones left out."""
    points: I64
    """(K,) thinned points of the component."""
    in_free_space: I64
    """(K,) thinned points that lie where the previous sweep saw free space."""
    max_points: int
    """Most points of a component that are compared."""

    @property
    def sigma_m(self) -> F64:
        """(K,) standard deviation of one coordinate of the shift."""
        return np.hypot(_SIGMA_M, _COST_SHARE * self.cost_m)

    def displacements_m(self, component: I64, xy_m: F64) -> F64:
        """Return (C, 2) displacements since the previous sweep of places (C, 2) on components."""
        cos, sin = np.cos(self.turn_rad[component]) - 1, np.sin(self.turn_rad[component])
        dx, dy = (xy_m - self.centre_m[component]).T
        rotated_m = np.column_stack([cos * dx - sin * dy, sin * dx + cos * dy])
        return -(rotated_m + self.shift_m[component])


@dataclass(frozen=True, slots=True)
class Labels:
    """Components of the thinned current points."""

    of_point: I64
    """(M,) component of each thinned point, -1 for none."""
    count: int


class SortedPoints(NamedTuple):
    """The current points sorted by component."""

    footprint: I64
    """(H, W) component of each cell of the raster, see `MatchScene`."""
    components: Components
    order: I64
    """(M,) index of each sorted point among the thinned points."""


class CurrentPoints:
    """The current sweep of a pair, thinned and indexed: the same for every past sweep."""

    def __init__(self, pair: SweepPair, config: CompareConfig) -> None:
        """Index the obstacle points of the current sweep."""
        self.config = config
        self.half_m = _half_width(pair)
        self.raster = BevGrid(-self.half_m, self.half_m, -self.half_m, self.half_m, config.cell_m)
        self.features = pair.current_features
        self.points_m = pair.current.xyz_m.take(self.features.thinned(config.voxel_m), axis=0)
        self._scaled_m = _scaled(self.points_m, config.z_scale)
        self.grid = build_point_grid(self._scaled_m, config.truncation_m / 2, self.half_m)
        self.rows, self.columns, _ = self.raster.cells(self.points_m)

    def sorted(self, labels: Labels) -> SortedPoints:
        """Return the points by component."""
        order = np.argsort(labels.of_point, kind="stable")
        order = order[np.searchsorted(labels.of_point[order], 0) :]
        spans = np.searchsorted(labels.of_point[order], np.arange(labels.count + 1))
        footprint = footprints(self.raster.shape, self.rows, self.columns, labels.of_point)
        return SortedPoints(footprint, Components(self._scaled_m[order], spans), order)

    def scene(self, past: PastSweep, footprint: I64) -> MatchScene:
        """Return the current sweep with one of the past."""
        config, half_m = self.config, self.half_m
        previous_m = past.obstacles.xyz_m.take(past.features.thinned(config.voxel_m), axis=0)
        return MatchScene(
            build_point_grid(_scaled(previous_m, config.z_scale), config.truncation_m / 2, half_m),
            self.grid,
            queried_from(past.features.image, past.sweep_T_current),
            self.features.image,
            footprint,
            (-half_m, -half_m),
            config.cell_m,
            config.z_scale,
            config.truncation_m,
        )


class Matcher:
    """Both sweeps of a pair, thinned and indexed."""

    def __init__(self, pair: SweepPair, config: MatchConfig) -> None:
        """Index the obstacle points of a pair."""
        self.config = config
        self.elapsed_s = pair.elapsed_s
        self.current = CurrentPoints(pair, config)
        then = pair.previous_features.thinned(config.voxel_m)
        self.previous_m = pair.previous.xyz_m[then]
        self._scene = self.current.scene(pair.past[-1], np.zeros((0, 0), np.int64))
        self._last: tuple[Labels, SortedPoints] | None = None

    @property
    def points_m(self) -> F32:
        """(M, 3) thinned points of the current sweep."""
        return self.current.points_m

    @property
    def raster(self) -> BevGrid:
        """The grid of footprints."""
        return self.current.raster

    def match(self, labels: Labels) -> Matches:
        """Register each component from zero motion and from the best shifts of a correlation."""
        config, (footprint, components, order) = self.config, self._sorted(labels)
        scene = self._scene._replace(footprint=footprint)
        at_rest = np.zeros((labels.count, 2))
        zero_motion = shift_costs(scene, components, at_rest, config.max_points)
        searched = zero_motion[:, 0] > config.search_above_m
        starts = self._correlate(order, components.spans, searched & self._short(components))
        limits = SearchLimits(
            config.max_points,
            config.max_speed_mps * self.elapsed_s,
            config.search_above_m,
            config.max_turn_radps * self.elapsed_s,
        )
        result = match_components(scene, components, starts, zero_motion, limits)
        return Matches(
            shift_m=result[:, :2],
            turn_rad=result[:, 2],
            centre_m=result[:, 3:5],
            cost_m=result[:, 5],
            significance=result[:, 6],
            zero_motion_cost_m=zero_motion[:, 0],
            compared=zero_motion[:, 1].astype(np.int64),
            points=np.diff(components.spans),
            in_free_space=self._in_free_space(order, components.spans),
            max_points=config.max_points,
        )

    def costs(self, labels: Labels, shift_m: F64) -> F64:
        """Return (K,) the cost of one given shift (K, 2) of each component, not registered."""
        footprint, components, _ = self._sorted(labels)
        scene = self._scene._replace(footprint=footprint)
        return shift_costs(scene, components, shift_m, self.config.max_points)[:, 0]

    def _sorted(self, labels: Labels) -> SortedPoints:
        if self._last is None or self._last[0] is not labels:
            self._last = labels, self.current.sorted(labels)
        return self._last[1]

    def _in_free_space(self, order: I64, spans: I64) -> I64:
        image = self._scene.previous_image
        free = states_of(image, self.points_m[order], _RANGE_TOLERANCE_M) == FREE
        before = np.append(0, np.cumsum(free))
        return np.diff(before[spans])

    def _short(self, components: Components) -> Mask:
        """Return (K,) components that are not longer than a vehicle can be."""
        points_m, spans = components
        if len(points_m) == 0:
            return np.zeros(len(spans) - 1, dtype=np.bool_)
        first = np.minimum(spans[:-1], len(points_m) - 1)
        low_m = np.minimum.reduceat(points_m[:, :2], first)
        high_m = np.maximum.reduceat(points_m[:, :2], first)
        short: Mask = (high_m - low_m).max(axis=1) < self.config.max_extent_m
        return short & (np.diff(spans) > 0)

    def _correlate(self, order: I64, spans: I64, wanted: Mask) -> Starts:
        """Return starts from the correlation of occupancy, in steps of a cell or more."""
        cell_m = self.config.cell_m
        radius = int(np.ceil(self.config.max_speed_mps * self.elapsed_s / cell_m))
        step = max(int(np.ceil(radius / _MAX_STEPS)), 1)
        distance = distance_map(self.raster.occupancy(self.previous_m), _TRUNCATION_STEPS * step)
        radius = int(np.ceil(radius / step))
        search = SearchGrid(radius, step, self.config.starts, _CORRELATED_POINTS)
        rows, columns = self.current.rows[order], self.current.columns[order]
        cells = np.column_stack([rows, columns])
        shifts, first = correlate_all(distance, cells, spans, wanted, search)
        return Starts(shifts[:, ::-1] * np.float64(cell_m), first)


def _scaled(points_m: F32, z_scale: float) -> F32:
    """Return the points (N, 3) with scaled heights."""
    scaled = points_m.copy()
    scaled[:, 2] *= np.float32(z_scale)
    return scaled


def _farthest_m(points_m: F32) -> float:
    """Return the largest coordinate in the plane of points (N, 3), at least 1 m."""
    return max(float(np.abs(points_m[:, k]).max(initial=1.0)) for k in (0, 1))


def _half_width(pair: SweepPair) -> float:
    """Return the half width of a square, a whole number of metres, that holds every sweep.

    What of a past sweep lies twice as far as the current one reaches, as after a long gap, is
    compared with nothing: it is left out, so that memory does not grow with the gap.
    """
    now_m = _farthest_m(pair.current.xyz_m)
    then_m = max(_farthest_m(past.obstacles.xyz_m) for past in pair.past)
    largest_m = max(now_m, min(then_m, 2.0 * max(now_m, pair.reach_m)))
    return float(np.ceil(largest_m + 0.5))  # the outermost cell is inside
