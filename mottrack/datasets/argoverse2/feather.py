"""Feather files to checked arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import DataError
from mottrack.datasets.faults import NonFiniteError
from mottrack.datasets.files import read_bytes

Columns = dict[str, NDArray[Any]]
POSE = ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
SIZE = ("length_m", "width_m", "height_m")


def read_columns(path: Path, numbers: tuple[str, ...], texts: tuple[str, ...] = ()) -> Columns:
    """Return the named columns; numbers are finite, integers stay integers.

    Raises:
        DataError: missing or damaged file, missing column, a value of another kind.

    """
    table = _table(path)
    columns: Columns = {}
    for name in (*numbers, *texts):
        count = table.column_names.count(name)
        if count != 1:
            expected = f"one column (there: {', '.join(table.column_names)})"
            raise DataError(path, name, f"given {count} times", expected)
        columns[name] = _column(path, table[name], name, text=name in texts)
    return columns


def _table(path: Path) -> pa.Table:
    try:
        table = pyarrow.feather.read_table(pa.BufferReader(read_bytes(path)))
        table.validate(full=True)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        first_line = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DataError(path, "content", f"unreadable ({first_line})", "a feather file") from error
    return table


def _column(path: Path, values: Any, name: str, *, text: bool) -> NDArray[Any]:
    if values.null_count:
        raise DataError(path, name, f"empty in {values.null_count} rows", "a value in each row")
    if text:
        strings = values.to_pylist()
        if not all(isinstance(value, str) for value in strings):
            raise DataError(path, name, str(values.type), "text")
        return np.array(strings, dtype=np.str_)
    array: NDArray[Any] = values.to_numpy()
    if array.dtype.kind not in "iuf":
        raise DataError(path, name, str(values.type), "numbers")
    if array.dtype.kind == "f":
        bad = np.flatnonzero(~np.isfinite(array))
        if bad.size:
            raise NonFiniteError(path, f"{name} of row {bad[0]}", float(array[bad[0]]), "finite")
    return array


def require_integers(path: Path, columns: Columns, name: str) -> I64:
    """Return a column of integers; raise DataError for fractions and what 64 bits can't hold."""
    if columns[name].dtype.kind not in "iu":
        raise DataError(path, name, str(columns[name].dtype), "integers")
    too_large = columns[name] > np.iinfo(np.int64).max
    refuse(path, np.asarray(too_large), name, columns[name], "an integer of 64 bits with sign")
    return columns[name].astype(np.int64)


def stacked(columns: Columns, names: tuple[str, ...]) -> F64:
    """Return (N, len(names)) float64."""
    return np.column_stack([columns[name].astype(np.float64) for name in names])


def refuse(path: Path, wrong: Mask, name: str, value: Any, expected: str) -> None:
    """Raise DataError for the first row where `wrong`; `value` is the column or its rows."""
    rows = np.flatnonzero(wrong)
    if rows.size:
        shown = np.asarray(value)[rows[0]].tolist()
        raise DataError(path, f"{name} of row {rows[0]}", shown, expected)
