"""Feather (Arrow) files to checked columns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather
from numpy.typing import NDArray

from mottrack.core.errors import DataError
from mottrack.formats.columns import Columns, ColumnSpec
from mottrack.formats.faults import NonFiniteError
from mottrack.formats.files import read_bytes

_DTYPE_KINDS: dict[type, str] = {int: "iu", float: "iuf", bool: "b"}
"""numpy's kinds of array that a column may be stored as."""


def read_feather_columns(
    path: Path, columns: tuple[ColumnSpec, ...], data: bytes | None = None
) -> Columns:
    """Return the named columns of single values; others are ignored.

    Args:
        path: the file.
        columns: what is read.
        data: content of the file where it lies in an archive; else it is read.

    Raises:
        DataError: missing or damaged file, missing column, a value of another kind.
    """
    table = _table(path, read_bytes(path) if data is None else data)
    arrays = {}
    for column in columns:
        count = table.column_names.count(column.name)
        if count != 1:
            expected = f"one column (there: {', '.join(table.column_names)})"
            raise DataError(path, column.name, f"given {count} times", expected)
        arrays[column.name] = _array(path, table[column.name], column)
    return Columns(path, arrays, np.arange(table.num_rows), _place)


def _place(name: str, row: int) -> str:
    return f"{name} of row {row}"


def _table(path: Path, data: bytes) -> pa.Table:
    try:
        table = pyarrow.feather.read_table(pa.BufferReader(data))
        table.validate(full=True)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        first_line = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DataError(path, "content", f"unreadable ({first_line})", "a feather file") from error
    return table


def _array(path: Path, values: Any, column: ColumnSpec) -> NDArray[Any]:
    name = column.name
    if values.null_count:
        raise DataError(path, name, f"empty in {values.null_count} rows", "a value in each row")
    if column.kind is str:
        strings = values.to_pylist()
        if not all(isinstance(value, str) for value in strings):
            raise DataError(path, name, str(values.type), "text")
        return column.array(strings)
    array: NDArray[Any] = values.to_numpy()
    if array.dtype.kind not in _DTYPE_KINDS[column.kind]:
        raise DataError(path, name, str(values.type), column.expected)
    return array if column.kind is bool else _numbers(path, array, column)


def _numbers(path: Path, array: NDArray[Any], column: ColumnSpec) -> NDArray[Any]:
    name = column.name
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise NonFiniteError(path, _place(name, bad[0]), float(array[bad[0]]), "a finite number")
    if column.kind is int:
        large = np.flatnonzero(array > np.iinfo(np.int64).max)
        if large.size:
            value = int(array[large[0]])
            raise DataError(path, _place(name, large[0]), value, "an integer of 64 bits with sign")
    return array.astype(np.int64 if column.kind is int else np.float64)
