"""World-aligned grids that follow the vehicle by whole cells."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Float = TypeVar("Float", bound=np.floating[Any])


def kept_slices(length: int, offset: int) -> tuple[slice, slice]:
    """Return where the kept cells of an axis lie after and before the grid moves by `offset`."""
    kept = max(length - abs(offset), 0)
    after, before = max(-offset, 0), max(offset, 0)
    return slice(after, after + kept), slice(before, before + kept)


def scrolled(values: NDArray[Float], offset: tuple[int, int], fill: float = 0.0) -> NDArray[Float]:
    """Return the values (rows, cols) after the grid moved by `offset` rows and columns.

    A value stays with its place in the world; cells that are new hold `fill`.
    """
    result = np.full_like(values, fill)
    row_to, row_from = kept_slices(values.shape[0], offset[0])
    col_to, col_from = kept_slices(values.shape[1], offset[1])
    result[row_to, col_to] = values[row_from, col_from]
    return result
