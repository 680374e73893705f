"""Registration of one component from a claimed motion, and the evidence for a motion, compiled.

Unlike `kernels.match_components` nothing competes here: a component is registered near the motion
that an estimator claims, as if it moved. Whether it does is decided later, from the evidence of all
earlier sweeps together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, Mask
from mottrack.flow.registration.kernels import (
    Component,
    Components,
    MatchScene,
    PlanarMotion,
    backward_distances,
    centre_and_radius,
    compared_points,
    forward_distances,
    in_footprint,
    is_unseen,
    moved_extent,
)
from mottrack.lidar.point_grid import nearest
from mottrack.lidar.residual import translation_icp

FIT_COLUMNS, EVIDENCE_COLUMNS = 9, 4
"""Of `fit_motions` and `motion_evidence`."""
_LEAST_OF_VARIANCE = 3
"""Points that have a variance."""
_MIN_VARIANCE_M2 = 0.01**2
"""No range measurement is better than a centimetre."""
_GATES = np.array([1.0, 0.8, 0.6, 0.5, 0.4])
"""Gates of the ICP, as shares of the truncation distance: a claim is off by less than that."""
_FIRST_STEP_M, _LAST_STEP_M = 0.05, 0.02
"""Steps of the pattern search: the spacing of the points, down to the noise of a range."""
_TURN_POINTS, _TURN_RADIUS_M = 40, 0.8
"""A vehicle's length shows its rotation, a pedestrian's outline does not."""
_PROBE_M = 0.1
"""Distance at which the curvature of the cost is probed: the spacing of the points, below which
the cost is rough."""


class FitLimits(NamedTuple):
    """Bounds of a registration."""

    max_points: int
    """Points of a component, and of the previous sweep, that are compared."""
    max_turn_rad: float
    min_points: int
    """Components with fewer points are not registered."""


class _Turning(NamedTuple):
    """Bounds of the rotation."""

    radius_m: float
    """Of the component; 0 where no rotation is searched."""
    max_turn_rad: float


@compiled
def fit_motions(
    scene: MatchScene, components: Components, starts: F64, wanted: Mask, limits: FitLimits
) -> F64:
    """Return (K, 9) of each component: a `PlanarMotion`, its cost, and the cost's curvature.

    Args:
        scene: the two sweeps.
        components: the current points.
        starts: (K, 3) shift and rotation to start from.
        wanted: (K,) components that are registered.
        limits: bounds of the search.

    The curvature is (xx, xy, yy) of the matrix A with cost(s + d) = cost(s) + d A d, in 1/m. A row
    that was not registered has its start, and NaN as its cost.
    """
    result = np.zeros((len(components.spans) - 1, FIT_COLUMNS))
    for k in range(len(result)):
        x, y, turn = starts[k, 0], starts[k, 1], starts[k, 2]
        result[k, 0], result[k, 1], result[k, 5] = x, y, np.nan
        count = components.spans[k + 1] - components.spans[k]
        if not wanted[k] or count < limits.min_points:
            continue
        component = compared_points(components, k, limits.max_points)
        centre_x, centre_y, radius_m = centre_and_radius(component.points_m)
        motion = PlanarMotion(x, y, turn, centre_x, centre_y)
        motion = _by_icp(scene, component.points_m, motion)
        then_m = _previous_points(scene, component, motion)
        turns = len(component.points_m) >= _TURN_POINTS and radius_m > _TURN_RADIUS_M
        bounds = _Turning(radius_m if turns else 0.0, limits.max_turn_rad)
        motion, cost = _descend(scene, component, then_m, motion, bounds)
        for i in range(5):
            result[k, i] = motion[i]
        result[k, 5] = cost
        _curvature(scene, component, then_m, motion, result[k, 5:])
    return result


@compiled
def motion_evidence(
    scene: MatchScene, components: Components, motions: F64, wanted: Mask, max_points: int
) -> F64:
    """Return (K, 4) of each wanted component: significance, cost, zero-motion cost, share seen.

    The significance is `t = mean(d_zero - d_moved) / (std / sqrt(n))`, paired by point: what the
    noise of the sensor and the gaps between its rings add to a distance is in both, and drops out.
    The share is that of the points whose place at rest the previous sweep could see.

    Args:
        scene: the two sweeps.
        components: the current points.
        motions: (K, 5) columns of a `PlanarMotion`.
        wanted: (K,) components that are compared; the others have NaN.
        max_points: points of a component that are compared.
    """
    result = np.full((len(components.spans) - 1, EVIDENCE_COLUMNS), np.nan)
    zero = PlanarMotion(0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(len(result)):
        if not wanted[k] or components.spans[k + 1] == components.spans[k]:
            continue
        component = compared_points(components, k, max_points)
        m = motions[k]
        motion = PlanarMotion(m[0], m[1], m[2], m[3], m[4])
        paired = _paired_distances(scene, component.points_m, motion)
        result[k, 0] = paired.significance
        moved, n_moved = backward_distances(scene, component, motion)
        rest, n_rest = backward_distances(scene, component, zero)
        result[k, 1] = _mean(paired.moved + moved, paired.n_moved + n_moved, scene.truncation_m)
        result[k, 2] = _mean(paired.rest + rest, paired.n_rest + n_rest, scene.truncation_m)
        result[k, 3] = paired.n_rest / len(component.points_m)
    return result


class _Paired(NamedTuple):
    """Sums of distances of points at rest and moved, and how clearly the latter are smaller."""

    rest: float
    n_rest: int
    moved: float
    n_moved: int
    significance: float


@compiled
def _paired_distances(scene: MatchScene, points_m: F32, motion: PlanarMotion) -> _Paired:
    shift_x, shift_y, turn_rad, centre_x, centre_y = motion
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    rest, n_rest, moved, n_moved, total, square = 0.0, 0, 0.0, 0, 0.0, 0.0
    for i in range(len(points_m)):
        x, y, z = points_m[i, 0], points_m[i, 1], points_m[i, 2]
        dx, dy = x - centre_x, y - centre_y
        then_x = cos * dx - sin * dy + centre_x + shift_x
        then_y = sin * dx + cos * dy + centre_y + shift_y
        k, rest2 = nearest(scene.previous, x, y, z, scene.truncation_m)
        seen = k >= 0 or not is_unseen(scene.previous_image, x, y, z / scene.z_scale)
        k, moved2 = nearest(scene.previous, then_x, then_y, z, scene.truncation_m)
        d_rest, d_moved = np.sqrt(rest2), np.sqrt(moved2)
        if seen:
            rest += d_rest
            n_rest += 1
            total += d_rest - d_moved
            square += (d_rest - d_moved) ** 2
        if k >= 0 or not is_unseen(scene.previous_image, then_x, then_y, z / scene.z_scale):
            moved += d_moved
            n_moved += 1
    if n_rest < _LEAST_OF_VARIANCE:
        return _Paired(rest, n_rest, moved, n_moved, 0.0)
    mean = total / n_rest
    variance = max(square / n_rest - mean * mean, _MIN_VARIANCE_M2)
    return _Paired(rest, n_rest, moved, n_moved, mean / np.sqrt(variance / n_rest))


@compiled
def _mean(total: float, count: int, otherwise: float) -> float:
    return total / count if count > 0 else otherwise


@compiled
def _by_icp(scene: MatchScene, points_m: F32, start: PlanarMotion) -> PlanarMotion:
    """Return the shift by ICP with the rotation of the start."""
    cos, sin = np.cos(start.turn_rad), np.sin(start.turn_rad)
    turned = np.empty_like(points_m)
    for i in range(len(points_m)):
        dx, dy = points_m[i, 0] - start.centre_x_m, points_m[i, 1] - start.centre_y_m
        turned[i, 0] = cos * dx - sin * dy + start.centre_x_m
        turned[i, 1] = sin * dx + cos * dy + start.centre_y_m
        turned[i, 2] = points_m[i, 2]
    gates_m = scene.truncation_m * _GATES
    x, y = translation_icp(scene.previous, turned, (start.x_m, start.y_m), gates_m)
    return PlanarMotion(x, y, start.turn_rad, start.centre_x_m, start.centre_y_m)


@compiled
def _previous_points(scene: MatchScene, component: Component, motion: PlanarMotion) -> F32:
    """Return the previous points (M, 3) in the moved footprint, one of `stride`.

    They are chosen once: the search moves by less than the footprint's rim of one cell.
    """
    grid = scene.previous
    extent = moved_extent(grid, component.points_m, motion, scene.cell_m)
    col_low, col_high, row_low, row_high = extent
    cos, sin = np.cos(motion.turn_rad), np.sin(motion.turn_rad)
    chosen = np.empty((2 * len(component.points_m) + 1, 3), np.float32)
    met, count = 0, 0
    if col_low > col_high:
        return chosen[:0]
    for row in range(row_low, row_high + 1):
        first = grid.start[row * grid.cols + col_low]
        last = grid.start[row * grid.cols + col_high + 1]
        for k in range(first, last):
            dx = grid.xyz_m[k, 0] - motion.centre_x_m - motion.x_m
            dy = grid.xyz_m[k, 1] - motion.centre_y_m - motion.y_m
            x, y = cos * dx + sin * dy + motion.centre_x_m, cos * dy - sin * dx + motion.centre_y_m
            if not in_footprint(scene, x, y, component.label):
                continue
            met += 1
            if met % component.stride == 0 and count < len(chosen):
                for i in range(3):
                    chosen[count, i] = grid.xyz_m[k, i]
                count += 1
    return chosen[:count]


@compiled
def _cost(scene: MatchScene, component: Component, then_m: F32, motion: PlanarMotion) -> float:
    """Return the mean truncated distance of a motion, with chosen previous points (M, 3)."""
    total, count = forward_distances(scene, component.points_m, motion)
    cos, sin = np.cos(motion.turn_rad), np.sin(motion.turn_rad)
    for i in range(len(then_m)):
        dx = then_m[i, 0] - motion.centre_x_m - motion.x_m
        dy = then_m[i, 1] - motion.centre_y_m - motion.y_m
        x, y = cos * dx + sin * dy + motion.centre_x_m, cos * dy - sin * dx + motion.centre_y_m
        k, d2 = nearest(scene.current, x, y, then_m[i, 2], scene.truncation_m)
        if k < 0 and is_unseen(scene.current_image, x, y, then_m[i, 2] / scene.z_scale):
            continue
        total += np.sqrt(d2)
        count += 1
    return float(total / count) if count else scene.truncation_m


@compiled
def _descend(
    scene: MatchScene,
    component: Component,
    then_m: F32,
    motion: PlanarMotion,
    turning: _Turning,
) -> tuple[PlanarMotion, float]:
    """Pattern search on the two-way cost."""
    radius_m, max_turn_rad = turning
    best = _cost(scene, component, then_m, motion)
    step = _FIRST_STEP_M
    while step > _LAST_STEP_M:
        improved = False
        for axis in range(3 if radius_m > 0 else 2):
            for sign in (1.0, -1.0):
                trial = PlanarMotion(
                    motion.x_m + (sign * step if axis == 0 else 0.0),
                    motion.y_m + (sign * step if axis == 1 else 0.0),
                    motion.turn_rad + (sign * step / radius_m if axis == 2 else 0.0),
                    motion.centre_x_m,
                    motion.centre_y_m,
                )
                if abs(trial.turn_rad) > max_turn_rad:
                    continue
                cost = _cost(scene, component, then_m, trial)
                if cost < best:
                    best, motion, improved = cost, trial, True
                    break
        if not improved:
            step /= 2
    return motion, best


@compiled
def _curvature(
    scene: MatchScene, component: Component, then_m: F32, motion: PlanarMotion, out: F64
) -> None:
    """Fill out[1:4] with the curvature of the cost out[0], from probes in eight directions."""
    rise = np.zeros(4)  # along x, y and the two diagonals
    for d in range(4):
        angle = 0.5 * np.pi * d if d < 2 else 0.25 * np.pi * (2 * d - 3)
        dx, dy = _PROBE_M * np.cos(angle), _PROBE_M * np.sin(angle)
        for sign in (1.0, -1.0):
            probe = PlanarMotion(
                motion.x_m + sign * dx,
                motion.y_m + sign * dy,
                motion.turn_rad,
                motion.centre_x_m,
                motion.centre_y_m,
            )
            rise[d] += 0.5 * (_cost(scene, component, then_m, probe) - out[0]) / _PROBE_M**2
    # least squares of d A d over the four directions
    mean = 0.25 * (rise[0] + rise[1] + rise[2] + rise[3])
    out[1] = mean + 0.5 * (rise[0] - rise[1])
    out[2] = 0.5 * (rise[2] - rise[3])
    out[3] = mean - 0.5 * (rise[0] - rise[1])
