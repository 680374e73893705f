"""Registration of components, compiled: where each was in the previous sweep, and how surely.

A hypothesis is a planar motion: current point `p` was at `R (p - c) + c + s`, with a shift `s` and
a rotation about the component's centre `c`. Its cost is the mean truncated distance, in both
directions, of the moved component to the previous points and of the previous points in the moved
footprint to the component. A point without a counterpart costs nothing where the other sweep could
not see it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I64
from mottrack.lidar.point_grid import CellRange, PointGrid, cells_within, nearest
from mottrack.lidar.residual import translation_icp
from mottrack.lidar.visibility import UNSEEN, RangeImage, state_at

_COARSE_POINTS = 30
"""Points of a component that are enough to rank its starts."""
_PRIOR = 0.015
_PRIOR_PER_POINT = 0.3
"""Metres of cost per metre of shift, and the same divided by the number of points, for sweeps 0.1 s
apart: fast is rarer than slow, and the fewer the points the more shifts fit them by chance."""
_PRIOR_RADIUS_M = 4.0
"""Search radius to which the prior refers (40 m/s over 0.1 s); a longer one has a weaker prior per
metre."""
_MIN_VARIANCE_M2 = 0.01**2
"""No range measurement is better than a centimetre."""
_REFINED_BELOW = 0.9
"""Largest cost of the best start, as a share of the zero-motion cost, that is refined locally: what
gains less than a tenth will not pass the motion test."""
_TURN_POINTS = 40
_TURN_RADIUS_M = 0.8
"""Points and radius from which the rotation is searched: a vehicle's length shows its rotation, a
pedestrian's outline does not."""
_FIRST_STEP_M, _LAST_STEP_M = 0.04, 0.012
"""Steps of the local refinement: half the voxel of the points, down to the noise of a range."""
_TOLERANCE_M = 0.5
"""Range beyond which a return is not on a place: the truncation distance of the costs."""


class MatchScene(NamedTuple):
    """Both sweeps, thinned, in the current ego frame, heights scaled by `z_scale`."""

    previous: PointGrid
    current: PointGrid
    previous_image: RangeImage
    current_image: RangeImage
    footprint: I64
    """(H, W) component of each cell, dilated into the empty cells around it; -1 for none."""
    corner_m: tuple[float, float]
    """Lower left corner of the footprint raster."""
    cell_m: float
    z_scale: float
    truncation_m: float


class Components(NamedTuple):
    """Current points of K components."""

    points_m: F32
    """(M, 3) sorted by component, heights scaled."""
    spans: I64
    """(K + 1,) first point of each."""


class Starts(NamedTuple):
    """Shifts from which K components are registered, beside zero motion."""

    shift_m: F64
    """(S, 2) planar shifts sorted by component."""
    spans: I64
    """(K + 1,) first start of each."""


class SearchLimits(NamedTuple):
    """Bounds of a registration."""

    max_points: int
    """Points of a component that are compared."""
    longest_m: float
    """Search radius."""
    search_above_m: float
    """Zero-motion cost below which a component without starts is not registered."""
    max_turn_rad: float


class Component(NamedTuple):
    """The compared points of one component."""

    points_m: F32
    """(N, 3), heights scaled."""
    label: int
    stride: int
    """Of how many of its points each compared one stands for."""


class PlanarMotion(NamedTuple):
    """A shift and a rotation about a centre, from the current place to the previous one."""

    x_m: float
    y_m: float
    turn_rad: float
    centre_x_m: float
    centre_y_m: float


@compiled
def hypothesis_cost(
    scene: MatchScene, component: Component, motion: PlanarMotion
) -> tuple[float, int]:
    """Return the mean truncated distance in both directions, and the number of points in it."""
    forward, n_forward = forward_distances(scene, component.points_m, motion)
    backward, n_backward = backward_distances(scene, component, motion)
    total = n_forward + n_backward
    return ((forward + backward) / total if total else scene.truncation_m), total


@compiled
def is_unseen(image: RangeImage, x_m: float, y_m: float, z_m: float) -> bool:
    """Return whether a sweep could not see a place."""
    # one specialisation of state_at for places of either precision: it computes in double anyway
    place = np.float64(x_m), np.float64(y_m), np.float64(z_m)
    return state_at(image, place[0], place[1], place[2], _TOLERANCE_M) == UNSEEN


@compiled
def forward_distances(scene: MatchScene, points_m: F32, motion: PlanarMotion) -> tuple[float, int]:
    """Return sum and number of distances of the moved component to the previous points."""
    shift_x, shift_y, turn_rad, centre_x, centre_y = motion
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    total, count = 0.0, 0
    for i in range(len(points_m)):
        dx, dy, z = points_m[i, 0] - centre_x, points_m[i, 1] - centre_y, points_m[i, 2]
        x = cos * dx - sin * dy + centre_x + shift_x
        y = sin * dx + cos * dy + centre_y + shift_y
        k, d2 = nearest(scene.previous, x, y, z, scene.truncation_m)
        if k < 0 and is_unseen(scene.previous_image, x, y, z / scene.z_scale):
            continue
        total += np.sqrt(d2)
        count += 1
    return total, count


@compiled
def backward_distances(
    scene: MatchScene, component: Component, motion: PlanarMotion
) -> tuple[float, int]:
    """Return sum and number of distances of previous points in the moved footprint to it."""
    grid = scene.previous
    shift_x, shift_y, turn_rad, centre_x, centre_y = motion
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    col_low, col_high, row_low, row_high = moved_extent(
        grid, component.points_m, motion, scene.cell_m
    )
    total, count, met = 0.0, 0, 0
    if col_low > col_high:
        return total, count
    for row in range(row_low, row_high + 1):
        first = grid.start[row * grid.cols + col_low]
        last = grid.start[row * grid.cols + col_high + 1]
        for k in range(first, last):
            dx = grid.xyz_m[k, 0] - centre_x - shift_x
            dy = grid.xyz_m[k, 1] - centre_y - shift_y
            x, y = cos * dx + sin * dy + centre_x, cos * dy - sin * dx + centre_y
            if not in_footprint(scene, x, y, component.label):
                continue
            met += 1
            if met % component.stride != 0:
                continue
            z = grid.xyz_m[k, 2]
            j, d2 = nearest(scene.current, x, y, z, scene.truncation_m)
            if j < 0 and is_unseen(scene.current_image, x, y, z / scene.z_scale):
                continue
            total += np.sqrt(d2)
            count += 1
    return total, count


@compiled
def in_footprint(scene: MatchScene, x_m: float, y_m: float, component: int) -> bool:
    """Return whether a place lies in the footprint of a component."""
    col = int((x_m - scene.corner_m[0]) // scene.cell_m)
    row = int((y_m - scene.corner_m[1]) // scene.cell_m)
    height, width = scene.footprint.shape
    if not (0 <= row < height and 0 <= col < width):
        return False
    return bool(scene.footprint[row, col] == component)


@compiled
def moved_extent(
    grid: PointGrid, points_m: F32, motion: PlanarMotion, margin_m: float
) -> CellRange:
    """Return the cells of the grid that hold the moved component and a margin."""
    low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
    for i in range(len(points_m)):
        low_x, high_x = min(low_x, points_m[i, 0]), max(high_x, points_m[i, 0])
        low_y, high_y = min(low_y, points_m[i, 1]), max(high_y, points_m[i, 1])
    margin_m += abs(motion.turn_rad) * (high_x - low_x + high_y - low_y)
    low_x, high_x = low_x + motion.x_m - margin_m, high_x + motion.x_m + margin_m
    low_y, high_y = low_y + motion.y_m - margin_m, high_y + motion.y_m + margin_m
    return cells_within(grid, low_x, high_x, low_y, high_y)


@compiled
def shift_costs(scene: MatchScene, components: Components, shifts_m: F64, max_points: int) -> F64:
    """Return (K, 2) the cost of one shift (K, 2) of each component, and the points in it."""
    costs = np.zeros((len(components.spans) - 1, 2))
    for k in range(len(costs)):
        component = compared_points(components, k, max_points)
        motion = PlanarMotion(shifts_m[k, 0], shifts_m[k, 1], 0.0, 0.0, 0.0)
        costs[k, 0], costs[k, 1] = hypothesis_cost(scene, component, motion)
    return costs


@compiled
def compared_points(components: Components, k: int, max_points: int) -> Component:
    """Return the points of component `k`, thinned evenly to about `max_points`."""
    first, last = components.spans[k], components.spans[k + 1]
    stride = max((last - first) // max_points, 1)
    return Component(np.ascontiguousarray(components.points_m[first:last:stride]), k, stride)


@compiled
def match_components(
    scene: MatchScene,
    components: Components,
    starts: Starts,
    zero_motion: F64,
    limits: SearchLimits,
) -> F64:
    """Return (K, 7) of each component: motion (5, a `PlanarMotion`), cost, significance.

    Args:
        scene: the two sweeps.
        components: the current points.
        starts: shifts to start from beside zero motion.
        zero_motion: (K, 2) of no shift, from `shift_costs`.
        limits: bounds of the search.
    """
    result = np.zeros((len(components.spans) - 1, 7))
    for k in range(len(result)):
        cost_m = zero_motion[k, 0]
        result[k, 5] = cost_m
        given = starts.shift_m[starts.spans[k] : starts.spans[k + 1]]
        points = components.spans[k + 1] - components.spans[k]
        if points == 0 or (cost_m < limits.search_above_m and len(given) == 0):
            continue
        candidates = np.zeros((len(given) + 1, 2))
        for i in range(len(given)):
            candidates[i + 1, 0], candidates[i + 1, 1] = given[i, 0], given[i, 1]
        component = compared_points(components, k, limits.max_points)
        motion, cost = _best_shift(scene, component, candidates, zero_motion[k], limits.longest_m)
        if cost < _REFINED_BELOW * cost_m:
            motion, cost = refine_locally(scene, component, motion, cost, limits.max_turn_rad)
            result[k, 6] = _significance(scene, component.points_m, motion)
        for i in range(len(motion)):
            result[k, i] = motion[i]
        result[k, 5] = cost
    return result


@compiled
def _best_shift(
    scene: MatchScene, component: Component, candidates: F64, zero_motion: F64, longest_m: float
) -> tuple[PlanarMotion, float]:
    """Return the best shift and its cost: coarse registration of all starts, fine of the best two.

    `zero_motion` (2,) are the cost of no shift and the number of points in it.
    """
    points_m = component.points_m
    prior = (_PRIOR + _PRIOR_PER_POINT / max(len(points_m), 1)) * _PRIOR_RADIUS_M / longest_m
    thinner = max(len(points_m) // _COARSE_POINTS, 1)
    coarse = Component(
        np.ascontiguousarray(points_m[::thinner]), component.label, component.stride * thinner
    )
    gates_m = scene.truncation_m * np.array([1.0, 1.0, 0.8, 0.7, 0.6])
    costs = np.full(len(candidates), np.inf)
    for s in range(len(candidates)):
        start = (candidates[s, 0], candidates[s, 1])
        x, y = translation_icp(scene.previous, coarse.points_m, start, gates_m)
        if x * x + y * y <= longest_m * longest_m:
            candidates[s, 0], candidates[s, 1] = x, y
            costs[s] = hypothesis_cost(scene, coarse, PlanarMotion(x, y, 0.0, 0.0, 0.0))[0]
            costs[s] += prior * np.hypot(x, y)
    best, best_motion = zero_motion[0], PlanarMotion(0.0, 0.0, 0.0, 0.0, 0.0)
    least = best
    gates_m = scene.truncation_m * np.array([0.7, 0.6, 0.5, 0.5, 0.4, 0.4])
    for s in np.argsort(costs)[:2]:
        if not np.isfinite(costs[s]):
            continue
        start = (candidates[s, 0], candidates[s, 1])
        x, y = translation_icp(scene.previous, points_m, start, gates_m)
        motion = PlanarMotion(x, y, 0.0, 0.0, 0.0)
        cost, compared = hypothesis_cost(scene, component, motion)
        penalised = cost + prior * np.hypot(x, y)
        # a shift into what was not seen leaves few points: half of those compared at rest remain
        if penalised < least and 2 * compared > zero_motion[1]:
            least, best, best_motion = penalised, cost, motion
    return best_motion, best


@compiled
def _significance(scene: MatchScene, points_m: F32, motion: PlanarMotion) -> float:
    """Return by how many standard errors a motion explains the current points better than none.

    Paired by point, `t = mean(d_zero - d_moved) / (std / sqrt(n))`: the noise of the sensor and
    the gaps between its rings are in both distances and drop out. Points that the previous sweep
    could not see at the current place are left out.
    """
    shift_x, shift_y, turn_rad, centre_x, centre_y = motion
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    total, square, count = 0.0, 0.0, 0
    for i in range(len(points_m)):
        x, y, z = points_m[i, 0], points_m[i, 1], points_m[i, 2]
        dx, dy = x - centre_x, y - centre_y
        then_x = cos * dx - sin * dy + centre_x + shift_x
        then_y = sin * dx + cos * dy + centre_y + shift_y
        k, zero2 = nearest(scene.previous, x, y, z, scene.truncation_m)
        if k < 0 and is_unseen(scene.previous_image, x, y, z / scene.z_scale):
            continue
        _, moved2 = nearest(scene.previous, then_x, then_y, z, scene.truncation_m)
        gain = np.sqrt(zero2) - np.sqrt(moved2)
        total += gain
        square += gain * gain
        count += 1
    if count < 3:  # no variance
        return 0.0
    mean = total / count
    variance = max(square / count - mean * mean, _MIN_VARIANCE_M2)
    return float(mean / np.sqrt(variance / count))


@compiled
def refine_locally(
    scene: MatchScene, component: Component, motion: PlanarMotion, best: float, max_turn_rad: float
) -> tuple[PlanarMotion, float]:
    """Pattern search on the two-way cost: ICP along a smooth side stops short of its minimum.

    The rotation is searched, too, where the component is large enough to determine one.
    """
    centre_x, centre_y, radius_m = centre_and_radius(component.points_m)
    x, y, turn = motion.x_m, motion.y_m, 0.0
    turns = len(component.points_m) >= _TURN_POINTS and radius_m > _TURN_RADIUS_M
    step = _FIRST_STEP_M
    while step > _LAST_STEP_M:
        improved = False
        for axis in range(3 if turns else 2):
            for sign in (1.0, -1.0):
                trial = PlanarMotion(
                    x + (sign * step if axis == 0 else 0.0),
                    y + (sign * step if axis == 1 else 0.0),
                    turn + (sign * step / radius_m if axis == 2 else 0.0),
                    centre_x,
                    centre_y,
                )
                if abs(trial.turn_rad) > max_turn_rad:
                    continue
                cost, _ = hypothesis_cost(scene, component, trial)
                if cost < best:
                    best, improved = cost, True
                    x, y, turn = trial.x_m, trial.y_m, trial.turn_rad
                    break
        if not improved:
            step /= 2
    return PlanarMotion(x, y, turn, centre_x, centre_y), best


class _Disc(NamedTuple):
    x_m: float
    y_m: float
    radius_m: float


@compiled
def centre_and_radius(points_m: F32) -> _Disc:
    """Return the centre and the root mean square distance from it, at least a tenth of a metre."""
    x, y, square = 0.0, 0.0, 0.0
    for i in range(len(points_m)):
        x += points_m[i, 0]
        y += points_m[i, 1]
    x, y = x / len(points_m), y / len(points_m)
    for i in range(len(points_m)):
        square += (points_m[i, 0] - x) ** 2 + (points_m[i, 1] - y) ** 2
    return _Disc(x, y, max(np.sqrt(square / len(points_m)), 0.1))
