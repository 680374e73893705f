"""The loops of the cost volume; maps are channels-last (B,H,W,C) float32."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Array = NDArray[np.float32]


@njit(cache=True, nogil=True, parallel=True, fastmath=True)
def correlate(current: Array, previous: Array, reach: int, costs: Array) -> None:
    """costs[b,y,x,s] = 1/C sum_c current[b,y,x,c] previous[b,y+dy,x+dx,c]."""
    batch, height, width, channels = current.shape
    side = 2 * reach + 1
    scale = np.float32(1.0 / channels)
    for line in prange(batch * height):
        b, y = line // height, line % height
        for x in range(width):
            for s in range(side * side):
                v, u = y + s // side - reach, x + s % side - reach
                total = np.float32(0.0)
                if 0 <= v < height and 0 <= u < width:
                    for c in range(channels):
                        total += current[b, y, x, c] * previous[b, v, u, c]
                costs[b, y, x, s] = total * scale


@njit(cache=True, nogil=True, parallel=True, fastmath=True)
def correlate_backward(
    slope: Array, current: Array, previous: Array, to_current: Array, to_previous: Array
) -> None:
    """Pull the gradient `slope` of the costs back to both maps (each written by its own cell)."""
    batch, height, width, channels = current.shape
    side = round(np.sqrt(slope.shape[3]))
    reach = side // 2
    scale = np.float32(1.0 / channels)
    for line in prange(batch * height):
        b, y = line // height, line % height
        for x in range(width):
            to_current[b, y, x, :] = 0.0
            to_previous[b, y, x, :] = 0.0
            for s in range(side * side):
                dy, dx = s // side - reach, s % side - reach
                if 0 <= y + dy < height and 0 <= x + dx < width:
                    g = slope[b, y, x, s] * scale
                    for c in range(channels):
                        to_current[b, y, x, c] += g * previous[b, y + dy, x + dx, c]
                if 0 <= y - dy < height and 0 <= x - dx < width:
                    g = slope[b, y - dy, x - dx, s] * scale
                    for c in range(channels):
                        to_previous[b, y, x, c] += g * current[b, y - dy, x - dx, c]
