"""Registration of the points in boxes, from every place that correlation proposes.

ICP finds the nearest minimum, and along a smooth side it stops short of it. So each box starts from
rest, from where its object would come by its last velocity, and from the best displacements of an
occupancy correlation over the whole disc that it can have come from; the starts are compared by
their cost in both directions, in which what one sweep could not see is no evidence, and the best of
them are refined by a pattern search on that cost.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F32, F64, I64
from mottrack.core.grid import BevGrid
from mottrack.core.objects import Boxes
from mottrack.flow.registration.components import footprints
from mottrack.flow.registration.correlation import SearchGrid, correlate_all, distance_map
from mottrack.flow.registration.kernels import (
    Component,
    MatchScene,
    PlanarMotion,
    hypothesis_cost,
    refine_locally,
)
from mottrack.flow.sweep_pair import SweepPair
from mottrack.lidar.in_boxes import points_in_boxes
from mottrack.lidar.point_grid import build_point_grid
from mottrack.lidar.residual import translation_icp
from mottrack.lidar.visibility import queried_from

_VOXEL_M = 0.05
"""One point per cube is compared: at 0.1 m the sampling hides displacements of 0.05 m."""
_CELL_M = 0.25
"""Cell of footprints and of the correlation."""
_TRUNCATION_M = 0.5
"""Truncation distance of the cost, and the farthest pair."""
_POINTS, _COARSE_POINTS = 800, 100
"""Points of a box that decide, and that rank its starts."""
_STARTS, _REFINED = 12, 3
"""Displacements of the correlation, and starts that are refined: more of either changed nothing."""
_CORRELATED_POINTS = 40
"""Points that the correlation compares."""
_GATES_M = _TRUNCATION_M * np.array([1.0, 1.0, 0.8, 0.7, 0.6, 0.6, 0.5, 0.5])
"""Farthest pair of each ICP step: from the reach of a start to the noise of the surface."""
_FAR_PER_M, _FAR_PER_M_AND_POINT = 0.003, 0.1
"""Cost of a metre of displacement, and the same divided by the points: few fit anywhere."""
_REST_M = 0.006
"""Advantage of rest: less than a quarter of the noise of a range."""
_SAME_M = 0.05
"""Starts that end this near each other are one."""
_WORST_M = 0.4
"""A worse cost is not a measurement: four fifths of the truncation."""


class BoxMotions(NamedTuple):
    """Motions of K boxes from the current place to the previous one."""

    motion: list[PlanarMotion | None]
    """None where it is not known."""
    inside: I64
    """(N,) box of each obstacle point of the current sweep, -1 for none."""


class BoxLimits(NamedTuple):
    """Bounds of a registration."""

    margin_m: float
    """Boxes grow by this on each side."""
    min_points: int
    """Boxes with fewer thinned points are not registered."""
    longest_m: float
    """Longest displacement."""
    max_turn_rad: float
    """Largest rotation between the sweeps."""


class BoxMatcher:
    """Both sweeps of a pair, thinned and indexed for the registration of boxes."""

    def __init__(self, pair: SweepPair, limits: BoxLimits) -> None:
        """Index the obstacle points of a pair."""
        self._pair, self._limits = pair, limits
        now, then = pair.current_features, pair.previous_features
        self._points_m = pair.current.xyz_m[now.thinned(_VOXEL_M)]
        self._previous_m = pair.previous.xyz_m[then.thinned(_VOXEL_M)]
        half_m = float(np.ceil(np.abs(self._points_m[:, :2]).max(initial=1.0) + 0.5))
        self._raster = BevGrid(-half_m, half_m, -half_m, half_m, _CELL_M)
        self._rows, self._columns, _ = self._raster.cells(self._points_m)
        self._scene = MatchScene(
            build_point_grid(self._previous_m, _TRUNCATION_M / 2, half_m),
            build_point_grid(self._points_m, _TRUNCATION_M / 2, half_m),
            queried_from(then.image, pair.previous_T_current),
            now.image,
            np.zeros((0, 0), np.int64),
            (-half_m, -half_m),
            _CELL_M,
            1.0,
            _TRUNCATION_M,
        )

    def match(self, boxes: Boxes, expected_m: list[F64]) -> BoxMotions:
        """Register every box.

        Args:
            boxes: K boxes, current ego frame.
            expected_m: (0 or 1, 2) of each box, a displacement to start from.
        """
        margin_m, count = self._limits.margin_m, len(boxes)
        shape = boxes.centre_m, boxes.size_m, boxes.yaw_rad
        label = points_in_boxes(self._points_m, *shape, margin_m).first_box(len(self._points_m))
        order = np.argsort(label, kind="stable")
        order = order[np.searchsorted(label[order], 0) :]
        spans = np.searchsorted(label[order], np.arange(count + 1))
        footprint = footprints(self._raster.shape, self._rows, self._columns, label)
        scene = self._scene._replace(footprint=footprint)
        starts, first = self._correlated(order, spans)
        motions: list[PlanarMotion | None] = []
        for k in range(count):
            points_m = self._points_m[order[spans[k] : spans[k + 1]]]
            proposed_m = np.vstack([np.zeros(2), expected_m[k], starts[first[k] : first[k + 1]]])
            enough = len(points_m) >= self._limits.min_points
            motions.append(self._best(scene, k, points_m, proposed_m) if enough else None)
        xyz_m = self._pair.current.xyz_m
        return BoxMotions(motions, points_in_boxes(xyz_m, *shape, margin_m).first_box(len(xyz_m)))

    def _correlated(self, order: I64, spans: I64) -> tuple[F64, I64]:
        """Return displacements (S, 2) and the first of each box (K + 1,)."""
        radius = int(np.ceil(self._limits.longest_m / _CELL_M))
        distance = distance_map(self._raster.occupancy(self._previous_m), 4.0)
        wanted = np.diff(spans) >= self._limits.min_points
        cells = np.column_stack([self._rows[order], self._columns[order]])
        search = SearchGrid(radius, 1, _STARTS, _CORRELATED_POINTS)
        shifts, first = correlate_all(distance, cells, spans, wanted, search)
        return shifts[:, ::-1] * np.float64(_CELL_M), first

    def _best(
        self, scene: MatchScene, box: int, points_m: F32, proposed_m: F64
    ) -> PlanarMotion | None:
        """Return the best motion of a box, None where it fits nowhere."""
        fine = _thinned(points_m, box, _POINTS)
        rest = PlanarMotion(0.0, 0.0, 0.0, 0.0, 0.0)
        rest_m, compared = hypothesis_cost(scene, fine, rest)
        best, least_m = rest, rest_m - _REST_M
        for start in self._ranked(scene, _thinned(points_m, box, _COARSE_POINTS), proposed_m):
            cost_m, seen = hypothesis_cost(scene, fine, start)
            if 2 * seen < compared:  # a place that was not seen leaves few points to compare
                continue
            turn_rad = self._limits.max_turn_rad
            motion, cost_m = refine_locally(scene, fine, start, cost_m, turn_rad)
            cost_m += _far_m(motion, fine)
            if cost_m < least_m:
                best, least_m = motion, cost_m
        return best if least_m < _WORST_M else None

    def _ranked(self, scene: MatchScene, coarse: Component, proposed_m: F64) -> list[PlanarMotion]:
        """Return where ICP ends from the proposed displacements, the best few, none twice."""
        ended: list[tuple[float, PlanarMotion]] = []
        for x_m, y_m in proposed_m.tolist():
            x, y = translation_icp(scene.previous, coarse.points_m, (x_m, y_m), _GATES_M)
            motion = PlanarMotion(x, y, 0.0, 0.0, 0.0)
            if np.hypot(x, y) <= self._limits.longest_m:
                cost_m, _ = hypothesis_cost(scene, coarse, motion)
                ended.append((cost_m + _far_m(motion, coarse), motion))
        kept: list[PlanarMotion] = []
        for _, motion in sorted(ended, key=lambda one: one[0]):
            apart = (np.hypot(motion.x_m - k.x_m, motion.y_m - k.y_m) > _SAME_M for k in kept)
            if len(kept) < _REFINED and all(apart):
                kept.append(motion)
        return kept


def displacements_m(motion: PlanarMotion, xy_m: F64) -> F64:
    """Return (C, 2) the displacements since the previous sweep of places (C, 2) on a box."""
    cos, sin = np.cos(motion.turn_rad) - 1.0, np.sin(motion.turn_rad)
    dx, dy = (xy_m - np.array([motion.centre_x_m, motion.centre_y_m])).T
    turned_m = np.column_stack([cos * dx - sin * dy, sin * dx + cos * dy])
    displacement_m: F64 = -(turned_m + np.array([motion.x_m, motion.y_m]))
    return displacement_m


def _thinned(points_m: F32, box: int, most: int) -> Component:
    stride = max(len(points_m) // most, 1)
    return Component(np.ascontiguousarray(points_m[::stride]), box, stride)


def _far_m(motion: PlanarMotion, component: Component) -> float:
    per_m = _FAR_PER_M + _FAR_PER_M_AND_POINT / len(component.points_m)
    return per_m * float(np.hypot(motion.x_m, motion.y_m))
