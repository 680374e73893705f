"""Where a component of the current sweep was in the previous one, and how sure that is.

A hypothesis is a planar motion: current point `p` was at `R (p - c) + c + s`, with a shift `s` and
a turn about the component's centre `c`. Its cost is what it leaves unexplained, in both
directions: the mean capped distance of the shifted component to the previous points, and of the
previous points in the shifted footprint to the component. A point without a partner costs nothing
where the other sweep could not see it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64, I64
from mottrack.lidar.point_grid import PointGrid, nearest
from mottrack.lidar.range_image import HIDDEN, RangeImage, state_at
from mottrack.lidar.residual import translation_icp

_COARSE = 30
"""Points of a component that tell its starts apart."""
_PRIOR = 0.015
_PRIOR_POINTS = 0.3
"""Metres of cost per metre of shift, and the same for one point, of a sweep each 0.1 s."""
_FASTEST_M = 4.0
"""Longest shift of a sweep each 0.1 s; the prior of a longer search is spread over its length."""
_LEAST_VARIANCE_M2 = 0.01**2
"""No range measurement is better than a centimetre."""
_WORTH_POLISHING = 0.9
"""Cost of the best start over the cost of rest, at most, for a finer search."""
_TURN_POINTS = 40
_TURN_RADIUS_M = 0.8
"""A vehicle's length shows its turn; a pedestrian's outline does not."""


class MatchScene(NamedTuple):
    """Both sweeps, thinned, in the current ego frame, heights scaled by `z_scale`."""

    previous: PointGrid
    current: PointGrid
    previous_image: RangeImage
    current_image: RangeImage
    footprint: I64
    """(H, W) component of each cell, grown into the empty cells around it; -1 for none."""
    corner_m: tuple[float, float]
    """Lower left corner of the footprint raster."""
    cell_m: float
    z_scale: float
    cap_m: float


Motion = tuple[float, float, float, float, float]
"""Shift x, y, turn in radians, and the centre x, y that it is about."""


@compiled
def hypothesis_cost(
    scene: MatchScene, points_m: F32, owner: tuple[int, int], motion: Motion
) -> tuple[float, int]:
    """Mean capped distance both ways of one motion, and how many points it is the mean of.

    Args:
        scene: the two sweeps.
        points_m: (N, 3) points of the component that are compared, heights scaled.
        owner: the component, and of how many of its points each compared one stands for.
        motion: from where the component is to where it was.
    """
    forward, n_forward = _forward(scene, points_m, motion)
    backward, n_backward = _backward(scene, points_m, owner, motion)
    total = n_forward + n_backward
    return ((forward + backward) / total if total else scene.cap_m), total


@compiled
def _forward(scene: MatchScene, points_m: F32, motion: Motion) -> tuple[float, int]:
    cos, sin = np.cos(motion[2]), np.sin(motion[2])
    centre_x, centre_y = motion[3], motion[4]
    total, count = 0.0, 0
    for i in range(len(points_m)):
        dx, dy, z = points_m[i, 0] - centre_x, points_m[i, 1] - centre_y, points_m[i, 2]
        x = cos * dx - sin * dy + centre_x + motion[0]
        y = sin * dx + cos * dy + centre_y + motion[1]
        k, d2 = nearest(scene.previous, x, y, z, scene.cap_m)
        if k < 0 and state_at(scene.previous_image, x, y, z / scene.z_scale, 0.5) == HIDDEN:
            continue
        total += np.sqrt(d2)
        count += 1
    return total, count


@compiled
def _backward(
    scene: MatchScene, points_m: F32, owner: tuple[int, int], motion: Motion
) -> tuple[float, int]:
    grid = scene.previous
    cos, sin = np.cos(motion[2]), np.sin(motion[2])
    centre_x, centre_y = motion[3], motion[4]
    col_low, col_high, row_low, row_high = _window(grid, points_m, motion, scene.cell_m)
    total, count, met = 0.0, 0, 0
    if col_low > col_high:
        return total, count
    for row in range(row_low, row_high + 1):
        first = grid.start[row * grid.cols + col_low]
        last = grid.start[row * grid.cols + col_high + 1]
        for k in range(first, last):
            dx = grid.xyz_m[k, 0] - centre_x - motion[0]
            dy = grid.xyz_m[k, 1] - centre_y - motion[1]
            x, y = cos * dx + sin * dy + centre_x, cos * dy - sin * dx + centre_y
            if not _inside(scene, x, y, owner[0]):
                continue
            met += 1
            if met % owner[1] != 0:
                continue
            z = grid.xyz_m[k, 2]
            j, d2 = nearest(scene.current, x, y, z, scene.cap_m)
            if j < 0 and state_at(scene.current_image, x, y, z / scene.z_scale, 0.5) == HIDDEN:
                continue
            total += np.sqrt(d2)
            count += 1
    return total, count


@compiled
def _inside(scene: MatchScene, x_m: float, y_m: float, component: int) -> bool:
    col = int((x_m - scene.corner_m[0]) // scene.cell_m)
    row = int((y_m - scene.corner_m[1]) // scene.cell_m)
    height, width = scene.footprint.shape
    if not (0 <= row < height and 0 <= col < width):
        return False
    return bool(scene.footprint[row, col] == component)


@compiled
def _window(
    grid: PointGrid, points_m: F32, motion: Motion, pad_m: float
) -> tuple[int, int, int, int]:
    """Columns and rows of the grid that hold the moved component and a margin."""
    low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
    for i in range(len(points_m)):
        low_x, high_x = min(low_x, points_m[i, 0]), max(high_x, points_m[i, 0])
        low_y, high_y = min(low_y, points_m[i, 1]), max(high_y, points_m[i, 1])
    pad_m += abs(motion[2]) * (high_x - low_x + high_y - low_y)
    col_low = max(int((low_x + motion[0] - pad_m - grid.x_min_m) // grid.cell_m), 0)
    col_high = min(int((high_x + motion[0] + pad_m - grid.x_min_m) // grid.cell_m), grid.cols - 1)
    row_low = max(int((low_y + motion[1] - pad_m - grid.y_min_m) // grid.cell_m), 0)
    row_high = min(int((high_y + motion[1] + pad_m - grid.y_min_m) // grid.cell_m), grid.rows - 1)
    return col_low, col_high, row_low, row_high


@compiled
def shift_costs(
    scene: MatchScene,
    components: tuple[F32, I64],
    shifts_m: F64,
    max_points: int,
) -> F64:
    """(K, 2) cost of one shift (K, 2) of each component, and how many points it is the mean of."""
    points_m, spans = components
    costs = np.zeros((len(spans) - 1, 2))
    for k in range(len(costs)):
        chosen, stride = _chosen(points_m, spans, k, max_points)
        shift = (shifts_m[k, 0], shifts_m[k, 1], 0.0, 0.0, 0.0)
        costs[k, 0], costs[k, 1] = hypothesis_cost(scene, chosen, (k, stride), shift)
    return costs


@compiled
def _chosen(points_m: F32, spans: I64, k: int, max_points: int) -> tuple[F32, int]:
    stride = max((spans[k + 1] - spans[k]) // max_points, 1)
    return np.ascontiguousarray(points_m[spans[k] : spans[k + 1] : stride]), stride


@compiled
def match_components(
    scene: MatchScene,
    components: tuple[F32, I64],
    starts: tuple[F64, I64],
    rest: F64,
    limits: tuple[int, float, float, float, int],
) -> F64:
    """(K, 7) of each component: its best motion (shift, turn, centre), its cost, significance.

    Args:
        scene: the two sweeps.
        components: (M, 3) current points sorted by component, heights scaled; (K + 1,) first
            point of each.
        starts: (S, 2) planar shifts to start from, sorted by component; (K + 1,) first start of
            each. Rest is always one.
        rest: (K, 2) of no shift, from `shift_costs`.
        limits: points that are compared, longest shift, cost of rest below which none is sought,
            largest turn, points below which a component is not registered.
    """
    points_m, spans = components
    result = np.zeros((len(spans) - 1, 7))
    for k in range(len(result)):
        result[k, 5] = rest[k, 0]
        given = starts[0][starts[1][k] : starts[1][k + 1]]
        held = spans[k + 1] - spans[k]
        if held < limits[4] or (rest[k, 0] < limits[2] and len(given) == 0):
            continue
        candidates = np.zeros((len(given) + 1, 2))
        candidates[1:] = given
        chosen, stride = _chosen(points_m, spans, k, limits[0])
        bounds = (rest[k, 0], rest[k, 1], limits[1])
        motion, cost = _best(scene, chosen, (k, stride), candidates, bounds)
        if cost < _WORTH_POLISHING * rest[k, 0]:
            motion, cost = _polish(scene, chosen, (k, stride), (motion, cost), limits[3])
            result[k, 6] = significance(scene, chosen, motion)
        result[k, :5], result[k, 5] = motion, cost
    return result


@compiled
def _best(
    scene: MatchScene,
    points_m: F32,
    owner: tuple[int, int],
    candidates: F64,
    bounds: tuple[float, float, float],
) -> tuple[Motion, float]:
    """Best shift over all starts: a coarse registration of each, a fine one of the best two."""
    rest_m, compared, longest_m = bounds
    # fast is rarer than slow, and the fewer the points the more shifts fit them by chance
    prior = (_PRIOR + _PRIOR_POINTS / max(len(points_m), 1)) * _FASTEST_M / longest_m
    thinner = max(len(points_m) // _COARSE, 1)
    coarse = np.ascontiguousarray(points_m[::thinner])
    gates_m = scene.cap_m * np.array([1.0, 1.0, 0.8, 0.7, 0.6])
    costs = np.full(len(candidates), np.inf)
    for s in range(len(candidates)):
        start = (candidates[s, 0], candidates[s, 1])
        x, y = translation_icp(scene.previous, coarse, start, gates_m)
        if x * x + y * y <= longest_m * longest_m:
            candidates[s, 0], candidates[s, 1] = x, y
            motion = (x, y, 0.0, 0.0, 0.0)
            costs[s] = hypothesis_cost(scene, coarse, (owner[0], owner[1] * thinner), motion)[0]
            costs[s] += prior * np.hypot(x, y)
    best, best_motion = rest_m, (0.0, 0.0, 0.0, 0.0, 0.0)
    least = rest_m
    gates_m = scene.cap_m * np.array([0.7, 0.6, 0.5, 0.5, 0.4, 0.4])
    for s in np.argsort(costs)[:2]:
        if not np.isfinite(costs[s]):
            continue
        start = (candidates[s, 0], candidates[s, 1])
        x, y = translation_icp(scene.previous, points_m, start, gates_m)
        motion = (x, y, 0.0, 0.0, 0.0)
        cost, n = hypothesis_cost(scene, points_m, owner, motion)
        weighed = cost + prior * np.hypot(x, y)
        if weighed < least and 2 * n > compared:
            least, best, best_motion = weighed, cost, motion
    return best_motion, best


@compiled
def significance(scene: MatchScene, points_m: F32, motion: Motion) -> float:
    """How many standard errors better a motion explains the current points than rest.

    Paired by point, `t = mean(d_rest - d_moved) / (std / sqrt(n))`: the noise of the sensor and
    the gaps between its rings are in both distances and drop out. Points that the previous sweep
    could not see, at either place, are left out.
    """
    cos, sin = np.cos(motion[2]), np.sin(motion[2])
    total, square, count = 0.0, 0.0, 0
    for i in range(len(points_m)):
        x, y, z = points_m[i, 0], points_m[i, 1], points_m[i, 2]
        dx, dy = x - motion[3], y - motion[4]
        then_x = cos * dx - sin * dy + motion[3] + motion[0]
        then_y = sin * dx + cos * dy + motion[4] + motion[1]
        k, rest2 = nearest(scene.previous, x, y, z, scene.cap_m)
        if k < 0 and state_at(scene.previous_image, x, y, z / scene.z_scale, 0.5) == HIDDEN:
            continue
        _, moved2 = nearest(scene.previous, then_x, then_y, z, scene.cap_m)
        gain = np.sqrt(rest2) - np.sqrt(moved2)
        total += gain
        square += gain * gain
        count += 1
    if count < 3:
        return 0.0
    mean = total / count
    variance = max(square / count - mean * mean, _LEAST_VARIANCE_M2)
    return float(mean / np.sqrt(variance / count))


@compiled
def _polish(
    scene: MatchScene,
    points_m: F32,
    owner: tuple[int, int],
    found: tuple[Motion, float],
    max_turn_rad: float,
) -> tuple[Motion, float]:
    """Pattern search on the two-way cost: ICP along a smooth side stops short of its minimum.

    The turn is searched, too, where the component is large enough to tell one.
    """
    (x, y, _, _, _), best = found
    centre_x, centre_y, radius_m = _middle(points_m)
    turn = 0.0
    turns = len(points_m) >= _TURN_POINTS and radius_m > _TURN_RADIUS_M
    step = 0.04
    while step > 0.012:
        improved = False
        for axis in range(3 if turns else 2):
            for sign in (1.0, -1.0):
                trial = (
                    x + (sign * step if axis == 0 else 0.0),
                    y + (sign * step if axis == 1 else 0.0),
                    turn + (sign * step / radius_m if axis == 2 else 0.0),
                    centre_x,
                    centre_y,
                )
                if abs(trial[2]) > max_turn_rad:
                    continue
                cost, _ = hypothesis_cost(scene, points_m, owner, trial)
                if cost < best:
                    best, improved = cost, True
                    x, y, turn = trial[0], trial[1], trial[2]
                    break
        if not improved:
            step /= 2
    return (x, y, turn, centre_x, centre_y), best


@compiled
def _middle(points_m: F32) -> tuple[float, float, float]:
    """Centre x, y and the root mean square distance from it, at least a tenth of a metre."""
    x, y, square = 0.0, 0.0, 0.0
    for i in range(len(points_m)):
        x += points_m[i, 0]
        y += points_m[i, 1]
    x, y = x / len(points_m), y / len(points_m)
    for i in range(len(points_m)):
        square += (points_m[i, 0] - x) ** 2 + (points_m[i, 1] - y) ** 2
    return x, y, max(np.sqrt(square / len(points_m)), 0.1)
