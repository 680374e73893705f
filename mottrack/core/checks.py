"""Checks that the core types run on construction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mottrack.core.arrays import Floats, Mask
from mottrack.core.errors import InputError

COVARIANCE_TOLERANCE = 1e-6
"""Asymmetry and negative determinant of a covariance, relative to its trace: the rounding of
float32, which flow sources compute in, with a factor of about ten to spare."""


MAX_PLACE_M = 1e8
"""The Earth's own coordinates stay below 1e7 m; a place beyond this is a damaged number."""


class Column(NamedTuple):
    """A column of a table: what each row holds."""

    dtype: Any
    shape: tuple[int, ...] = ()
    """Of one row: () a scalar, (3,) a vector."""


Columns = dict[str, Column]


def as_array(
    field: str, value: object, dtype: DTypeLike, shape: tuple[int | None, ...]
) -> NDArray[Any]:
    """Return ``value`` as a read-only view of ``dtype`` and ``shape`` (None: any length).

    An array that has the dtype already is not copied: its owner must not write to it later.

    Raises:
        InputError: naming the field, with the actual and the expected shape, or with the first
            entry that is no whole number where integers are expected, no text where labels are.
    """
    try:
        given = np.asarray(value)
        if given is not value:
            _refuse_masked(field, value)
        if given.dtype != dtype:
            _require_kind(field, given, np.dtype(dtype))
        with np.errstate(invalid="ignore", over="ignore"):
            array = given if given.dtype == dtype else given.astype(dtype, copy=False)
    except InputError:
        raise
    except (TypeError, ValueError, OverflowError) as error:
        ragged = "inhomogeneous" in str(error)
        found = "rows of unequal length" if ragged else f"of type {type(value).__name__}"
        raise InputError(field, found, f"an array of {np.dtype(dtype)}") from error
    if array.shape == (0,) and len(shape) > 1 and shape[0] in (None, 0) and None not in shape[1:]:
        array = array.reshape(0, *shape[1:])  # an empty list: no rows
    if not _fits(array.shape, shape):
        want = "(" + ", ".join("N" if n is None else str(n) for n in shape) + ")"
        raise InputError(f"shape of {field}", array.shape, want)
    if array is not given:
        _require_nothing_lost(field, given, array)
    return _read_only(array)


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    return array


def _fits(have: tuple[int, ...], want: tuple[int | None, ...]) -> bool:
    if have == want:
        return True
    return len(have) == len(want) and all(
        n is None or n == m for n, m in zip(want, have, strict=True)
    )


def _refuse_masked(field: str, value: object) -> None:
    """Refuse masked entries: numpy would hand over what the mask hides."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise InputError(field, "a masked array with masked entries", "values, or fewer rows")


def _require_kind(field: str, given: NDArray[Any], dtype: np.dtype[Any]) -> None:
    """Refuse what numpy converts although it means something else: text to numbers or truth."""
    if given.size == 0:
        return
    texts = given.dtype.kind in "US" or (
        given.dtype.kind == "O" and any(isinstance(item, str | bytes) for item in given.flat)
    )
    wrong = dtype.kind in "fiub" and (texts or given.dtype.kind in "cmM")
    if dtype.kind == "b" and not wrong:
        wrong = not bool(np.isin(given, (0, 1)).all())
    if wrong:
        kind = "text" if texts else f"{given.dtype} other than 0 and 1"
        raise InputError(field, kind, f"an array of {dtype}")


def _require_nothing_lost(field: str, given: NDArray[Any], array: NDArray[Any]) -> None:
    """Refuse what a cast would change silently: 1.5 to 1, NaN to an integer, None to "None"."""
    if array.dtype.kind in "iu" and given.dtype.kind in "iuf":
        require_all(field, given, given == array, f"a whole number that fits {array.dtype}")
    if array.dtype.kind == "U" and given.dtype.kind == "O":
        texts = np.array([isinstance(item, str) for item in given.flat], np.bool_)
        require_all(field, given, texts.reshape(given.shape), "text")


def set_array(
    owner: object, field: str, dtype: DTypeLike, shape: tuple[int | None, ...]
) -> NDArray[Any]:
    """Replace a field of a frozen dataclass by the array that `as_array` makes of it."""
    value = getattr(owner, field)
    if type(value) is np.ndarray and _has(value, dtype) and _fits(value.shape, shape):
        array = _read_only(value)  # what trackers and readers hand over: nothing to convert
    else:
        array = as_array(field, value, dtype, shape)
    object.__setattr__(owner, field, array)
    return array


def _has(array: NDArray[Any], dtype: DTypeLike) -> bool:
    """Return whether an array needs no conversion to `dtype`; text is of any length."""
    wanted = np.dtype(dtype)
    return array.dtype is wanted or array.dtype == wanted or array.dtype.kind == wanted.kind == "U"


def set_columns(owner: object, columns: Mapping[str, Column], may_be_nan: frozenset[str]) -> int:
    """Check every column of a table, as `set_array` does, and return the number of rows.

    Raises:
        InputError: a shape is wrong, the lengths differ, or a number is not finite.
    """
    rows: int | None = None
    for name, (dtype, shape) in columns.items():
        array = set_array(owner, name, dtype, (rows, *shape))
        rows = len(array)
        if array.dtype.kind == "f" and name not in may_be_nan:
            require_finite(name, array)
    return rows or 0


def set_stamp(owner: object) -> None:
    """Replace the field ``stamp_ns`` of a frozen dataclass by the integer that `as_stamp` makes."""
    object.__setattr__(owner, "stamp_ns", as_stamp("stamp_ns", owner.stamp_ns))  # type: ignore[attr-defined]


def require_instance(field: str, value: object, kind: type[Any]) -> None:
    """Raise InputError unless ``value`` is a ``kind``."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise InputError(field, f"of type {type(value).__name__}", f"{article} {kind.__name__}")


def require_finite(field: str, array: NDArray[Any]) -> None:
    """Raise InputError naming the first entry of ``array`` that is NaN or infinite."""
    finite = np.isfinite(array)
    if not np.logical_and.reduce(finite, axis=None):  # `all` costs half as much again
        require_all(field, array, finite, "a finite number")


def require_within(field: str, array: NDArray[Any], most: float, unit: str) -> None:
    """Raise InputError naming the first entry that is not finite, or larger than ``most``.

    Squares of what is let through do not overflow.
    """
    if array.size and not (array.min() >= -most and array.max() <= most):  # NaN fails too
        require_finite(field, array)
        require_all(field, array, np.abs(array) <= most, f"within {most:g} {unit}".rstrip())


def require_all(field: str, array: NDArray[Any], good: Mask, expected: str) -> None:
    """Raise InputError naming the first entry of ``array`` where ``good`` is false."""
    if not good.all():
        first = tuple(int(i) for i in np.argwhere(~good)[0])
        found = array[first]
        raise InputError(
            f"{field}{list(first)}",
            found.tolist() if isinstance(found, np.ndarray) else found,
            expected,
        )


def require_covariance(field: str, covariance: Floats) -> None:
    """Raise InputError unless every matrix of (..., 2, 2) is symmetric positive semi-definite."""
    require_finite(field, covariance)
    xx, yy = covariance[..., 0, 0], covariance[..., 1, 1]
    xy, yx = covariance[..., 0, 1], covariance[..., 1, 0]
    scale = np.maximum(xx + yy, 0.0)
    tolerance = COVARIANCE_TOLERANCE * scale
    good = (xx >= 0) & (yy >= 0) & (np.abs(xy - yx) <= tolerance)
    good &= xy * yx <= xx * yy + tolerance * scale
    require_all(field, covariance, good, "a symmetric positive semi-definite matrix")


def as_stamp(field: str, value: object) -> int:
    """Return an integer stamp in nanoseconds; refuse floats, which lose nanoseconds.

    Raises:
        InputError: the value is not an integer, or does not fit in 64 bits.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InputError(field, repr(value), "an integer of nanoseconds")
    if not -(2**63) <= value < 2**63:
        raise InputError(field, value, "an integer of nanoseconds that fits in 64 bits")
    return int(value)
