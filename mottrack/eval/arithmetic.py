"""Arithmetic that several metrics share: sums of counts, ratios and bins of a quantity."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from itertools import pairwise
from typing import Any, TypeVar, overload

import numpy as np

from mottrack.core.arrays import F64, I64, Mask

Counts = TypeVar("Counts")

MOSTLY_TRACKED, MOSTLY_LOST = 0.8, 0.2
"""Share of its frames in which a true track is matched (Wu and Nevatia, 2006; all protocols)."""
SPEED_EDGES_MPS = (0.0, 0.2, 1.0, 3.0, 8.0, np.inf)
"""Standing (below the noise of labelled velocities), walking pace, cycling, urban traffic."""


@overload
def ratio(part: float, whole: float) -> float: ...
@overload
def ratio(part: F64, whole: F64 | float) -> F64: ...
def ratio(part: F64 | float, whole: F64 | float) -> Any:
    """Return part / whole, element by element; NaN where the whole is 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        quotient = np.where(np.greater(whole, 0), np.divide(part, whole), np.nan)
    return quotient if quotient.ndim else float(quotient)


@overload
def mota(errors: float, truth: float) -> float: ...
@overload
def mota(errors: F64, truth: F64 | float) -> F64: ...
def mota(errors: F64 | float, truth: F64 | float) -> Any:
    """Return 1 - (misses + false positives + switches) / true boxes; NaN without truth.

    Bernardin and Stiefelhagen, 2008, section 2.3. May be negative.
    """
    return 1.0 - ratio(errors, truth)  # type: ignore[arg-type]


def distinct(values: I64) -> I64:
    """Return the different values, ascending.

    `np.unique` does the same, but its first call imports numpy.ma, a tenth of a small evaluation.
    """
    ordered = np.sort(values)
    first = np.ones(len(ordered), np.bool_)
    first[1:] = ordered[1:] != ordered[:-1]
    return np.asarray(ordered[first], np.int64)


def total(parts: Iterable[Counts], empty: Counts) -> Counts:
    """Return the sum of dataclasses of counts, field by field, `empty` where there is none."""
    listed = list(parts)
    names = [field.name for field in fields(empty)]  # type: ignore[arg-type]
    sums = {n: sum((getattr(c, n) for c in listed), start=getattr(empty, n)) for n in names}
    return type(empty)(**sums)


def bins(values: F64, edges: tuple[float, ...], unit: str, name: str = "") -> dict[str, Mask]:
    """Return the mask of the values in each [low, high), keyed by `name [low, high) unit`."""
    return {
        f"{name} [{low:g}, {high:g}) {unit}".lstrip(): (values >= low) & (values < high)
        for low, high in pairwise(edges)
    }
