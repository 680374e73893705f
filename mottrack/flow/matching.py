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
    scene: MatchScene, points_m: NDArray[np.float32], component: int, shift_m: tuple[float, float]
) -> tuple[float, int]:
    """Mean capped distance both ways of one shift, and how many points it is the mean of."""
    forward, n_forward = _forward(scene, points_m, shift_m)
    backward, n_backward = _backward(scene, points_m, component, shift_m)
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
    component: int,
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
    total, count = 0.0, 0
    if col_low > col_high:
        return total, count
    for row in range(row_low, row_high + 1):
        first = grid.start[row * grid.cols + col_low]
        last = grid.start[row * grid.cols + col_high + 1]
        for k in range(first, last):
            x, y, z = grid.xyz_m[k, 0] - shift_m[0], grid.xyz_m[k, 1] - shift_m[1], grid.xyz_m[k, 2]
            c = int((x - scene.corner_m[0]) // scene.cell_m)
            r = int((y - scene.corner_m[1]) // scene.cell_m)
            if not (0 <= r < height and 0 <= c < width) or scene.footprint[r, c] != component:
                continue
            j, d2 = nearest(scene.current, x, y, z, scene.cap_m)
            if j < 0 and state_at(scene.current_image, x, y, z / scene.z_scale, 0.5) == HIDDEN:
                continue
            total += np.sqrt(d2)
            count += 1
    return total, count


@njit(cache=True)
def rest_costs(
    scene: MatchScene,
    points_m: NDArray[np.float32],
    spans: NDArray[np.int64],
    max_points: int,
) -> NDArray[np.float64]:
    """(K,) cost of no motion of each component; arguments as `match_components`."""
    cost = np.zeros(len(spans) - 1)
    for k in range(len(spans) - 1):
        stride = max((spans[k + 1] - spans[k]) // max_points, 1)
        chosen = np.ascontiguousarray(points_m[spans[k] : spans[k + 1] : stride])
        cost[k], _ = hypothesis_cost(scene, chosen, k, (0.0, 0.0))
    return cost


@njit(cache=True)
def match_components(
    scene: MatchScene,
    points_m: NDArray[np.float32],
    spans: NDArray[np.int64],
    starts_m: NDArray[np.float64],
    start_spans: NDArray[np.int64],
    limits: tuple[int, float],
) -> NDArray[np.float64]:
    """(K, 5) of each component: shift x, y, its cost, the cost of rest, points compared.

    Args:
        scene: the two sweeps.
        points_m: (M, 3) current points sorted by component, heights scaled.
        spans: (K + 1,) first point of each component.
        starts_m: (S, 2) planar shifts to start from, sorted by component; rest is always one.
        start_spans: (K + 1,) first start of each component.
        limits: points per component that are compared, and the longest shift.
    """
    count = len(spans) - 1
    result = np.zeros((count, 5))
    gates_m = scene.cap_m * np.array([1.0, 1.0, 0.8, 0.8, 0.6, 0.6, 0.5, 0.5, 0.4, 0.4])
    for k in range(count):
        size = spans[k + 1] - spans[k]
        if size == 0:
            continue
        stride = max(size // limits[0], 1)
        chosen = np.ascontiguousarray(points_m[spans[k] : spans[k + 1] : stride])
        rest, compared = hypothesis_cost(scene, chosen, k, (0.0, 0.0))
        best, best_shift = rest, (0.0, 0.0)
        for s in range(start_spans[k] - 1, start_spans[k + 1]):
            start = (0.0, 0.0)
            if s >= start_spans[k]:
                start = (starts_m[s, 0], starts_m[s, 1])
            shift = translation_icp(scene.previous, chosen, start, gates_m)
            if shift[0] ** 2 + shift[1] ** 2 > limits[1] ** 2:
                continue
            cost, n = hypothesis_cost(scene, chosen, k, shift)
            if cost < best and 2 * n > compared:
                best, best_shift = cost, shift
        if best < 0.8 * rest:
            best, best_shift = _polish(scene, chosen, k, best_shift, best)
        result[k, 0], result[k, 1] = best_shift
        result[k, 2], result[k, 3], result[k, 4] = best, rest, compared
    return result


@njit(cache=True)
def _polish(
    scene: MatchScene,
    points_m: NDArray[np.float32],
    component: int,
    shift_m: tuple[float, float],
    cost_m: float,
) -> tuple[float, tuple[float, float]]:
    """Pattern search on the two-way cost: ICP along a smooth side stops short of its minimum."""
    best, x, y = cost_m, shift_m[0], shift_m[1]
    step = 0.16
    while step > 0.015:
        improved = False
        for dx, dy in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
            trial = (x + step * dx, y + step * dy)
            cost, _ = hypothesis_cost(scene, points_m, component, trial)
            if cost < best:
                best, improved = cost, True
                x, y = trial
                break
        if not improved:
            step /= 2
    return best, (x, y)
