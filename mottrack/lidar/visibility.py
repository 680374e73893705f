"""What a sweep could see: a polar free-space raster.

Every return says that its ray was free up to there. Per azimuth the farthest return, ground
included, bounds what was seen from the optical centre; a cell beyond it was hidden, and nothing
is known about what stood there.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mottrack.core.grid import BevGrid
from mottrack.core.sweep import Sweep

UNSEEN, FREE, OCCUPIED = 0, 1, 2
_BINS = 720
"""0.5 degrees: wider than the azimuth step of any rotating LiDAR, so that no bin stays empty."""


def visibility_raster(
    sweep: Sweep, kept_xyz_m: NDArray[np.float32], grid: BevGrid
) -> NDArray[np.int8]:
    """(H, W) state of each cell: UNSEEN, FREE or OCCUPIED by a kept (non-ground) point.

    Args:
        sweep: all returns, ground included, and the optical centre, in the frame of the grid.
        kept_xyz_m: (N, 3) the points that make a cell occupied, same frame.
        grid: the raster.
    """
    centre_x_m, centre_y_m = float(sweep.origin_m[0]), float(sweep.origin_m[1])
    farthest_m = _farthest(np.array(sweep.xyz_m), centre_x_m, centre_y_m)
    extent = (grid.x_min_m - centre_x_m, grid.y_min_m - centre_y_m, grid.cell_m)
    seen = np.empty(grid.shape, np.int8)
    _fill(seen, farthest_m, extent)
    seen[grid.occupancy(kept_xyz_m)] = OCCUPIED
    return seen


@njit(cache=True)
def _farthest(
    xyz_m: NDArray[np.float32], centre_x_m: float, centre_y_m: float
) -> NDArray[np.float64]:
    farthest_m = np.zeros(_BINS)
    for i in range(len(xyz_m)):
        dx, dy = xyz_m[i, 0] - centre_x_m, xyz_m[i, 1] - centre_y_m
        k = int((np.arctan2(dy, dx) + np.pi) / (2 * np.pi) * _BINS) % _BINS
        range_m = np.sqrt(dx * dx + dy * dy)
        farthest_m[k] = max(farthest_m[k], range_m)
    return farthest_m


@njit(cache=True)
def _fill(
    seen: NDArray[np.int8], farthest_m: NDArray[np.float64], extent: tuple[float, float, float]
) -> None:
    x_min_m, y_min_m, cell_m = extent
    for row in range(seen.shape[0]):
        y_m = y_min_m + (row + 0.5) * cell_m
        for col in range(seen.shape[1]):
            x_m = x_min_m + (col + 0.5) * cell_m
            k = int((np.arctan2(y_m, x_m) + np.pi) / (2 * np.pi) * _BINS) % _BINS
            seen[row, col] = FREE if np.sqrt(x_m * x_m + y_m * y_m) <= farthest_m[k] else UNSEEN
