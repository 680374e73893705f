"""Checks that the core types run when they are made."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mottrack.core.errors import InputError

T = TypeVar("T", bound=np.generic)


def as_array(
    field: str, value: object, dtype: DTypeLike, shape: tuple[int | None, ...]
) -> NDArray[Any]:
    """Returns ``value`` as a read-only array of ``dtype`` and ``shape`` (None: any length).

    Raises:
        InputError: naming the field, with the actual and the expected shape.
    """
    try:
        array = np.asarray(value, dtype=dtype)
    except (TypeError, ValueError) as error:
        raise InputError(field, type(value).__name__, f"an array of {np.dtype(dtype)}") from error
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        want = "(" + ", ".join("N" if n is None else str(n) for n in shape) + ")"
        raise InputError(f"shape of {field}", array.shape, want)
    view = array.view()
    view.flags.writeable = False
    return view


def require_finite(field: str, array: NDArray[Any]) -> None:
    """Raises InputError naming the first entry of ``array`` that is NaN or infinite."""
    if not np.isfinite(array).all():
        first = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{field}{list(first)}", array[first], "a finite number")


def require_all(field: str, array: NDArray[Any], good: NDArray[np.bool_], expected: str) -> None:
    """Raises InputError naming the first entry of ``array`` where ``good`` is false."""
    if not good.all():
        first = tuple(int(i) for i in np.argwhere(~good)[0])
        raise InputError(f"{field}{list(first)}", array[first], expected)


def require_covariance(field: str, covariance: NDArray[np.floating[Any]]) -> None:
    """Raises InputError unless every matrix of (..., 2, 2) is symmetric positive semi-definite."""
    require_finite(field, covariance)
    xx, yy = covariance[..., 0, 0], covariance[..., 1, 1]
    xy, yx = covariance[..., 0, 1], covariance[..., 1, 0]
    scale = np.maximum(xx + yy, 0.0)
    tolerance = 1e-6 * scale
    good = (xx >= 0) & (yy >= 0) & (np.abs(xy - yx) <= tolerance)
    good &= xy * yx <= xx * yy + tolerance * scale
    if not good.all():
        first = tuple(int(i) for i in np.argwhere(~good)[0])
        raise InputError(
            f"{field}{list(first)}",
            np.asarray(covariance[first]).tolist(),
            "a symmetric positive semi-definite matrix",
        )


def as_stamp(field: str, value: object) -> int:
    """Returns an integer stamp in nanoseconds; refuses floats, which lose nanoseconds.

    Raises:
        InputError: the value is not an integer.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InputError(field, repr(value), "an integer of nanoseconds")
    return int(value)
