"""Connected components of an occupancy grid, constrained by a detector's boxes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask

# cells that touch by a corner are connected: walls seen at an angle fall into a chain of corners
_EIGHT_NEIGHBOURS = np.ones((3, 3), np.bool_)


class CellLabels(NamedTuple):
    """Component of every occupied cell."""

    row: I64
    """(C,) occupied cells, in order of rows, then columns."""
    column: I64
    """(C,)."""
    label: I64
    """(C,) 0..number-1."""
    number: int

    def of(self, row: I64, column: I64, shape: tuple[int, ...]) -> I64:
        """Return the labels of these cells, all of them occupied, of a grid of that shape."""
        image = np.empty(shape, np.int64)
        image[self.row, self.column] = self.label
        return image[row, column]


def component_labels(occupied: Mask, owner: I64 | None = None, join_cells: int = 0) -> CellLabels:
    """Label the components of the occupied cells (H, W).

    Free cells (`owner` -1) are joined with their eight neighbours. Cells of a detector's mask
    (`owner` >= 0) are one cluster per box, in however many pieces, and never join the cells
    outside: touching objects are separated and one object is not split (section V-A). Outside,
    gaps of up to `2 * join_cells` empty cells are bridged.
    """
    row, column = np.nonzero(occupied)
    masked = np.zeros_like(occupied) if owner is None else occupied & (owner >= 0)
    joined = _grown(occupied & ~masked, join_cells) & ~masked
    found, count = ndimage.label(joined, structure=_EIGHT_NEIGHBOURS)
    label = found[row, column].astype(np.int64) - 1
    if owner is not None:
        box = owner[row, column]
        label = np.where(box >= 0, count + box, label)
    return CellLabels(row, column, *_dense(label))


def split_large(cells: CellLabels, tile: int, corner: tuple[int, int]) -> CellLabels:
    """Cut components longer than twice `tile` cells into tiles that are fixed to the world.

    A wall of 60 m is not one object: its hull would cover the cars before it, and its visible part
    moves along with the vehicle. `corner` is the world cell (row, column) of the grid's first.
    """
    large = np.zeros(cells.number, np.bool_)
    for axis in (cells.row, cells.column):
        low, high = np.full(cells.number, np.iinfo(np.int64).max), np.full(cells.number, -1)
        np.minimum.at(low, cells.label, axis)
        np.maximum.at(high, cells.label, axis)
        large |= high - low >= 2 * tile
    cut = large[cells.label]
    if not cut.any():
        return cells
    down, across = (cells.row[cut] + corner[0]) // tile, (cells.column[cut] + corner[1]) // tile
    span = np.int64(across.max() - across.min() + 1)
    tiles = (down - down.min()) * span + across - across.min()
    label = cells.label.copy()
    label[cut] = cells.number + tiles * cells.number + label[cut]
    return CellLabels(cells.row, cells.column, *_dense(label))


def _dense(label: I64) -> tuple[I64, int]:
    """Return the same partition with labels 0..n-1, in the order of the labels, and n."""
    kept, fresh = np.unique(label, return_inverse=True)
    return fresh.reshape(-1), len(kept)


def _grown(mask: Mask, cells: int) -> Mask:
    """Dilate by a square of `2 * cells + 1` cells, one axis after the other."""
    grown = mask.copy()
    for shift in range(1, cells + 1):
        grown[shift:] |= mask[:-shift]
        grown[:-shift] |= mask[shift:]
    wide = grown.copy()
    for shift in range(1, cells + 1):
        wide[:, shift:] |= grown[:, :-shift]
        wide[:, :-shift] |= grown[:, shift:]
    return wide


@compiled
def box_mask(boxes: F64, shape: tuple[int, int], cell_m: float) -> I64:
    """Return (H, W) the index of the box that contains a cell's centre, -1 where none does.

    `boxes` (B, 5): centre x, y from the grid's corner, length, width, heading. Where rectangles
    overlap, the cell belongs to the box in which it lies deepest.
    """
    owner = np.full(shape, -1, np.int64)
    depth = np.full(shape, -np.inf)
    for b in range(len(boxes)):
        x, y, length, width, heading = boxes[b]
        reach = 0.5 * np.hypot(length, width)
        cos, sin = np.cos(heading), np.sin(heading)
        for row in range(
            max(int((y - reach) / cell_m), 0), min(int((y + reach) / cell_m) + 1, shape[0])
        ):
            for column in range(
                max(int((x - reach) / cell_m), 0), min(int((x + reach) / cell_m) + 1, shape[1])
            ):
                dx, dy = (column + 0.5) * cell_m - x, (row + 0.5) * cell_m - y
                inside = min(
                    0.5 * length - abs(dx * cos + dy * sin), 0.5 * width - abs(dy * cos - dx * sin)
                )
                if inside >= 0.0 and inside > depth[row, column]:
                    depth[row, column] = inside
                    owner[row, column] = b
    return owner
