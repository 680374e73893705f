"""Where a component of the current sweep was in the previous one, and how sure that is.

A hypothesis is a planar shift `s`: current point `p` was at `p + s`. Its cost is what it leaves
unexplained, in both directions: the mean capped distance of the shifted component to the previous
points, and of the previous points in the shifted footprint to the component. A point without a
partner costs nothing where the other sweep could not see it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mottrack.lidar.point_grid import PointGrid, nearest
from mottrack.lidar.range_image import HIDDEN, RangeImage, state_at
from mottrack.lidar.residual import translation_icp


_COARSE = 30
"""Points of a component that tell its starts apart."""


class MatchScene(NamedTuple):
    """Both sweeps, thinned, in the current ego frame, heights scaled by `z_scale`."""

    previous: PointGrid
    current: PointGrid
    previous_image: RangeImage
    current_image: RangeImage
    footprint: NDArray[np.int64]
    """(H, W) component of each cell, grown into the empty cells around it; -1 for none."""
    corner_m: tuple[float, float]
    """Lower left corner of the footprint raster."""
    cell_m: float
    z_scale: float
    cap_m: float


@njit(cache=True)
def hypothesis_cost(
    scene: MatchScene,
    points_m: NDArray[np.float32],
    owner: tuple[int, int],
    shift_m: tuple[float, float],
) -> tuple[float, int]:
    """Mean capped distance both ways of one shift, and how many points it is the mean of.

    Args:
        scene: the two sweeps.
        points_m: (N, 3) points of the component that are compared, heights scaled.
        owner: the component, and of how many of its points each compared one stands for.
        shift_m: where the component was, less where it is.
    """
    forward, n_forward = _forward(scene, points_m, shift_m)
    backward, n_backward = _backward(scene, points_m, owner, shift_m)
    total = n_forward + n_backward
    return ((forward + backward) / total if total else scene.cap_m), total


@njit(cache=True)
def _forward(
    scene: MatchScene, points_m: NDArray[np.float32], shift_m: tuple[float, float]
) -> tuple[float, int]:
    total, count = 0.0, 0
    for i in range(len(points_m)):
        x, y, z = points_m[i, 0] + shift_m[0], points_m[i, 1] + shift_m[1], points_m[i, 2]
        k, d2 = nearest(scene.previous, x, y, z, scene.cap_m)
        if k < 0 and state_at(scene.previous_image, x, y, z / scene.z_scale, 0.5) == HIDDEN:
            continue
        total += np.sqrt(d2)
        count += 1
    return total, count


@njit(cache=True)
def _backward(
    scene: MatchScene,
    points_m: NDArray[np.float32],
    owner: tuple[int, int],
    shift_m: tuple[float, float],
) -> tuple[float, int]:
    grid = scene.previous
    height, width = scene.footprint.shape
    low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
    for i in range(len(points_m)):
        low_x, high_x = min(low_x, points_m[i, 0]), max(high_x, points_m[i, 0])
        low_y, high_y = min(low_y, points_m[i, 1]), max(high_y, points_m[i, 1])
    pad = scene.cell_m
    col_low = max(int((low_x + shift_m[0] - pad - grid.x_min_m) // grid.cell_m), 0)
    col_high = min(int((high_x + shift_m[0] + pad - grid.x_min_m) // grid.cell_m), grid.cols - 1)
    row_low = max(int((low_y + shift_m[1] - pad - grid.y_min_m) // grid.cell_m), 0)
    row_high = min(int((high_y + shift_m[1] + pad - grid.y_min_m) // grid.cell_m), grid.rows - 1)
    total, count, met = 0.0, 0, 0
    if col_low > col_high:
        return total, count
    for row in range(row_low, row_high + 1):
        first = grid.start[row * grid.cols + col_low]
        last = grid.start[row * grid.cols + col_high + 1]
        for k in range(first, last):
            x, y, z = grid.xyz_m[k, 0] - shift_m[0], grid.xyz_m[k, 1] - shift_m[1], grid.xyz_m[k, 2]
            c = int((x - scene.corner_m[0]) // scene.cell_m)
            r = int((y - scene.corner_m[1]) // scene.cell_m)
            if not (0 <= r < height and 0 <= c < width) or scene.footprint[r, c] != owner[0]:
                continue
            met += 1
            if met % owner[1] != 0:
                continue
            j, d2 = nearest(scene.current, x, y, z, scene.cap_m)
            if j < 0 and state_at(scene.current_image, x, y, z / scene.z_scale, 0.5) == HIDDEN:
                continue
            total += np.sqrt(d2)
            count += 1
    return total, count


@njit(cache=True)
def shift_costs(
    scene: MatchScene,
    components: tuple[NDArray[np.float32], NDArray[np.int64]],
    shifts_m: NDArray[np.float64],
    max_points: int,
) -> NDArray[np.float64]:
    """(K, 2) cost of one shift (K, 2) of each component, and how many points it is the mean of."""
    points_m, spans = components
    costs = np.zeros((len(spans) - 1, 2))
    for k in range(len(costs)):
        chosen, stride = _chosen(points_m, spans, k, max_points)
        shift = (shifts_m[k, 0], shifts_m[k, 1])
        costs[k, 0], costs[k, 1] = hypothesis_cost(scene, chosen, (k, stride), shift)
    return costs


@njit(cache=True)
def _chosen(
    points_m: NDArray[np.float32], spans: NDArray[np.int64], k: int, max_points: int
) -> tuple[NDArray[np.float32], int]:
    stride = max((spans[k + 1] - spans[k]) // max_points, 1)
    return np.ascontiguousarray(points_m[spans[k] : spans[k + 1] : stride]), stride


@njit(cache=True)
def match_components(
    scene: MatchScene,
    components: tuple[NDArray[np.float32], NDArray[np.int64]],
    starts: tuple[NDArray[np.float64], NDArray[np.int64]],
    rest: NDArray[np.float64],
    limits: tuple[int, float, float],
) -> NDArray[np.float64]:
    """(K, 3) of each component: its best shift x, y, and the cost of that.

    Args:
        scene: the two sweeps.
        components: (M, 3) current points sorted by component, heights scaled; (K + 1,) first
            point of each.
        starts: (S, 2) planar shifts to start from, sorted by component; (K + 1,) first start of
            each. Rest is always one.
        rest: (K, 2) of no shift, from `shift_costs`.
        limits: points that are compared, longest shift, cost of rest below which none is sought.
    """
    points_m, spans = components
    result = np.zeros((len(spans) - 1, 3))
    for k in range(len(result)):
        result[k, 2] = rest[k, 0]
        given = starts[0][starts[1][k] : starts[1][k + 1]]
        if spans[k + 1] == spans[k] or (rest[k, 0] < limits[2] and len(given) == 0):
            continue
        candidates = np.zeros((len(given) + 1, 2))
        candidates[1:] = given
        chosen, stride = _chosen(points_m, spans, k, limits[0])
        shift, cost = _best(
            scene, chosen, (k, stride), candidates, (rest[k, 0], rest[k, 1], limits[1])
        )
        result[k, 0], result[k, 1], result[k, 2] = shift[0], shift[1], cost
    return result


@njit(cache=True)
def _best(
    scene: MatchScene,
    points_m: NDArray[np.float32],
    owner: tuple[int, int],
    candidates: NDArray[np.float64],
    bounds: tuple[float, float, float],
) -> tuple[tuple[float, float], float]:
    """Best shift over all starts: a coarse registration of each, a fine one of the best two."""
    rest_m, compared, longest_m = bounds
    coarse = np.ascontiguousarray(points_m[:: max(len(points_m) // _COARSE, 1)])
    gates_m = scene.cap_m * np.array([1.0, 1.0, 0.8, 0.7, 0.6])
    costs = np.full(len(candidates), np.inf)
    for s in range(len(candidates)):
        start = (candidates[s, 0], candidates[s, 1])
        x, y = translation_icp(scene.previous, coarse, start, gates_m)
        if x * x + y * y <= longest_m * longest_m:
            candidates[s, 0], candidates[s, 1] = x, y
            costs[s] = hypothesis_cost(
                scene, coarse, (owner[0], owner[1] * max(len(points_m) // _COARSE, 1)), (x, y)
            )[0]
    best, best_shift = rest_m, (0.0, 0.0)
    gates_m = scene.cap_m * np.array([0.7, 0.6, 0.5, 0.5, 0.4, 0.4])
    for s in np.argsort(costs)[:2]:
        if not np.isfinite(costs[s]):
            continue
        start = (candidates[s, 0], candidates[s, 1])
        shift = translation_icp(scene.previous, points_m, start, gates_m)
        cost, n = hypothesis_cost(scene, points_m, owner, shift)
        if cost < best and 2 * n > compared:
            best, best_shift = cost, shift
    if best < 0.9 * rest_m:
        best, best_shift = _polish(scene, points_m, owner, (best_shift, best))
    return best_shift, best


@njit(cache=True)
def _polish(
    scene: MatchScene,
    points_m: NDArray[np.float32],
    owner: tuple[int, int],
    found: tuple[tuple[float, float], float],
) -> tuple[float, tuple[float, float]]:
    """Pattern search on the two-way cost: ICP along a smooth side stops short of its minimum."""
    (x, y), best = found
    step = 0.16
    while step > 0.015:
        improved = False
        for dx, dy in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
            trial = (x + step * dx, y + step * dy)
            cost, _ = hypothesis_cost(scene, points_m, owner, trial)
            if cost < best:
                best, improved = cost, True
                x, y = trial
                break
        if not improved:
            step /= 2
    return best, (x, y)
