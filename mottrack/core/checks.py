"""Checks that the core types run when they are made."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mottrack.core.arrays import Floats, Mask
from mottrack.core.errors import InputError

T = TypeVar("T", bound=np.generic)


def as_array(
    field: str, value: object, dtype: DTypeLike, shape: tuple[int | None, ...]
) -> NDArray[Any]:
    """Returns ``value`` as a read-only view of ``dtype`` and ``shape`` (None: any length).

    An array that has the dtype already is not copied: whoever made it must not write to it later.

    Raises:
        InputError: naming the field, with the actual and the expected shape, or with the first
            entry that is no whole number where integers are expected, no text where labels are.
    """
    _refuse_masked(field, value)
    try:
        given = np.asarray(value)
        _require_kind(field, given, np.dtype(dtype))
        array = given if given.dtype == dtype else _converted(given, dtype)
    except InputError:
        raise
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(field, type(value).__name__, f"an array of {np.dtype(dtype)}") from error
    if array.shape == (0,) and len(shape) > 1 and shape[0] is None and None not in shape[1:]:
        array = array.reshape(0, *shape[1:])  # an empty list: no rows
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        want = "(" + ", ".join("N" if n is None else str(n) for n in shape) + ")"
        raise InputError(f"shape of {field}", array.shape, want)
    if array is not given:
        _require_nothing_lost(field, given, array)
    view = array.view()
    view.flags.writeable = False
    return view


def _refuse_masked(field: str, value: object) -> None:
    """Refuses masked entries: numpy would hand over what the mask hides."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise InputError(field, "a masked array with masked entries", "values, or fewer rows")


def _require_kind(field: str, given: NDArray[Any], dtype: np.dtype[Any]) -> None:
    """Refuses what numpy converts although it means something else: text to numbers or truth."""
    if given.dtype == dtype or given.size == 0:
        return
    texts = given.dtype.kind in "USM" or (
        given.dtype.kind == "O" and any(isinstance(item, str | bytes) for item in given.flat)
    )
    wrong = dtype.kind in "fiub" and (texts or given.dtype.kind in "cmM")
    if dtype.kind == "b" and not wrong and given.dtype != dtype:
        wrong = not bool(np.isin(given, (0, 1)).all())
    if wrong:
        kind = "text" if texts else str(given.dtype)
        raise InputError(field, kind, f"an array of {dtype}")


def _converted(given: NDArray[Any], dtype: DTypeLike) -> NDArray[Any]:
    with np.errstate(invalid="ignore", over="ignore"):
        return given.astype(dtype, copy=False)


def _require_nothing_lost(field: str, given: NDArray[Any], array: NDArray[Any]) -> None:
    """Refuses what a change of type would change in silence: 1.5 to 1, NaN to a number, a None."""
    if array.dtype.kind in "iu" and given.dtype.kind in "iuf":
        require_all(field, given, given == array, f"a whole number that fits {array.dtype}")
    if array.dtype.kind == "U" and given.dtype.kind == "O":
        texts = np.array([isinstance(item, str) for item in given.flat], np.bool_)
        require_all(field, given, texts.reshape(given.shape), "text")


def require_instance(field: str, value: object, kind: type[Any]) -> None:
    """Raises InputError unless ``value`` is a ``kind``."""
    if not isinstance(value, kind):
        raise InputError(field, f"of type {type(value).__name__}", f"a {kind.__name__}")


def require_finite(field: str, array: NDArray[Any]) -> None:
    """Raises InputError naming the first entry of ``array`` that is NaN or infinite."""
    if not np.isfinite(array).all():
        first = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{field}{list(first)}", array[first], "a finite number")


def require_all(field: str, array: NDArray[Any], good: Mask, expected: str) -> None:
    """Raises InputError naming the first entry of ``array`` where ``good`` is false."""
    if not good.all():
        first = tuple(int(i) for i in np.argwhere(~good)[0])
        raise InputError(f"{field}{list(first)}", array[first], expected)


def require_covariance(field: str, covariance: Floats) -> None:
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
        InputError: the value is not an integer, or does not fit in 64 bits.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InputError(field, repr(value), "an integer of nanoseconds")
    if not -(2**63) <= value < 2**63:
        raise InputError(field, value, "an integer of nanoseconds that fits in 64 bits")
    return int(value)
