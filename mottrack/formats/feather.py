"""Feather (Arrow) files to checked columns."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.ipc
from numpy.typing import NDArray

from mottrack.core.errors import DataError
from mottrack.core.limits import MAX_ROWS, Limit
from mottrack.formats.columns import Columns, ColumnSpec
from mottrack.formats.faults import NonFiniteError, TruncatedError
from mottrack.formats.files import read_bytes

# Arrow checks most of a damaged file itself: this is what it raises
_FAULTS = (
    pa.ArrowException,
    OSError,
    UnicodeDecodeError,
    OverflowError,
    MemoryError,
    struct.error,
)
_MAGIC_BYTES = 8
"""`ARROW1` and its padding; messages follow as in a stream."""
_VERSION_1 = b"FEA1"
_U16, _U32, _I32, _I64 = (struct.Struct(f"<{code}") for code in "HIiq")


def read_feather_columns(
    path: Path,
    columns: tuple[ColumnSpec, ...],
    limit: Limit = MAX_ROWS,
    data: bytes | None = None,
) -> Columns:
    """Return the named columns of single values; others are not even unpacked.

    Args:
        path: the file.
        columns: what is read.
        limit: how many rows it may have.
        data: content of the file where it lies in an archive; else it is read.

    Raises:
        DataError: missing or damaged file, more rows than the limit, missing column, a value of
            another kind.
    """
    content = read_bytes(path) if data is None else data
    table = _table(path, content, columns, limit)
    arrays = {column.name: checked_array(path, table[column.name], column) for column in columns}
    return Columns(path, arrays, np.arange(table.num_rows), _place)


def feather_names(path: Path) -> list[str]:
    """Return the names of the columns of a file.

    Raises:
        DataError: missing or damaged file.
    """
    content = read_bytes(path)
    try:
        return list(pa.ipc.open_file(pa.py_buffer(content)).schema.names)
    except _FAULTS as error:
        first_line = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DataError(path, "content", f"unreadable ({first_line})", "a feather file") from error


def _place(name: str, row: int) -> str:
    return f"{name} of row {row}"


def _table(path: Path, content: bytes, columns: tuple[ColumnSpec, ...], limit: Limit) -> pa.Table:
    if not content:
        raise TruncatedError(path, "size in bytes", 0, "a feather file")
    if content.startswith(_VERSION_1):
        raise DataError(path, "content", "feather version 1", "version 2 (an Arrow file)")
    data = pa.py_buffer(content)
    try:
        reader = pa.ipc.open_file(data)
        names = reader.schema.names
        _require_columns(path, names, columns)
        _require_rows(path, data, limit)
        if len(names) > len(columns):
            wanted = [names.index(column.name) for column in columns]
            options = pa.ipc.IpcReadOptions(included_fields=wanted)
            reader = pa.ipc.open_file(data, options=options)
        table = reader.read_all()
        table.validate(full=True)
    except _FAULTS as error:
        first_line = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DataError(path, "content", f"unreadable ({first_line})", "a feather file") from error
    return table


def _require_columns(path: Path, names: list[str], columns: tuple[ColumnSpec, ...]) -> None:
    for column in columns:
        count = names.count(column.name)
        if count != 1:
            expected = f"one column (there: {', '.join(names)})"
            raise DataError(path, column.name, f"given {count} times", expected)


def _require_rows(path: Path, data: pa.Buffer, limit: Limit) -> None:
    """Refuse a file of more rows, before anything of it is unpacked."""
    rows = sum(map(rows_of_message, pa.ipc.MessageReader.open_stream(data.slice(_MAGIC_BYTES))))
    if rows > limit.value:
        raise DataError(path, "rows", rows, limit.expected("rows"))


def rows_of_message(message: pa.ipc.Message) -> int:
    """Return how many rows a message of an Arrow file says that it holds, 0 for a schema.

    pyarrow tells it only after unpacking. The message is a flatbuffer: a table knows by its vtable
    where each of its fields is, Message.header is its third, RecordBatch.length its first and
    DictionaryBatch.data its second (Arrow columnar format, "Message.fbs").
    """
    if message.type not in ("record batch", "dictionary"):
        return 0
    metadata = message.metadata.to_pybytes()
    table = _followed(metadata, _field(metadata, _followed(metadata, 0), 2))
    if message.type == "dictionary":
        table = _followed(metadata, _field(metadata, table, 1))
    place = _field(metadata, table, 0)
    return int(_I64.unpack_from(metadata, place)[0]) if place else 0


def _followed(data: bytes, place: int) -> int:
    return int(place + _U32.unpack_from(data, place)[0])


def _field(data: bytes, table: int, number: int) -> int:
    """Return the place of a field of a flatbuffer's table, 0 where it has its default."""
    vtable = table - _I32.unpack_from(data, table)[0]
    slot = 4 + 2 * number
    if slot >= _U16.unpack_from(data, vtable)[0]:
        return 0
    offset = _U16.unpack_from(data, vtable + slot)[0]
    return int(table + offset) if offset else 0


def checked_array(path: Path, values: Any, column: ColumnSpec) -> NDArray[Any]:
    """Return a column of an Arrow table as an array.

    Raises:
        DataError: an empty value where the column has no default, or a value of another kind.
    """
    if values.null_count and column.blank is not None:
        values = values.fill_null(column.blank)
    if values.null_count:
        found = f"empty in {values.null_count} rows"
        raise DataError(path, column.name, found, "a value in each row")
    return _texts(path, values, column) if column.kind is str else _numbers(path, values, column)


def _texts(path: Path, values: Any, column: ColumnSpec) -> NDArray[Any]:
    try:
        strings = values.to_pylist()
    except _FAULTS as error:
        raise DataError(path, column.name, f"unreadable ({error})", "text") from error
    if not pa.types.is_string(values.type) and not all(isinstance(v, str) for v in strings):
        raise DataError(path, column.name, str(values.type), "text")
    if not "".join(strings).isprintable():
        row, text = next((i, text) for i, text in enumerate(strings) if not text.isprintable())
        raise DataError(path, _place(column.name, row), text, column.expected)
    return column.array(strings)


def _numbers(path: Path, values: Any, column: ColumnSpec) -> NDArray[Any]:
    if column.kind is bool:
        if not pa.types.is_boolean(values.type):
            raise DataError(path, column.name, str(values.type), column.expected)
        truths: NDArray[Any] = values.to_numpy()
        return truths
    whole = pa.types.is_integer(values.type)
    if not whole and (column.kind is int or not pa.types.is_floating(values.type)):
        raise DataError(path, column.name, str(values.type), column.expected)
    array: NDArray[Any] = values.to_numpy()
    if not whole:
        _require_finite(path, array, column)
    if column.kind is int and array.dtype == np.uint64:
        large = np.flatnonzero(array > np.iinfo(np.int64).max)
        if large.size:
            place, value = _place(column.name, large[0]), int(array[large[0]])
            raise DataError(path, place, value, "an integer of 64 bits with sign")
    return array.astype(np.int64 if column.kind is int else np.float64, copy=False)


def _require_finite(path: Path, array: NDArray[Any], column: ColumnSpec) -> None:
    """Refuse a number that is not finite, but for NaN where a blank is read as that."""
    good = np.isfinite(array)
    if column.blank is not None and np.isnan(column.blank):
        good |= np.isnan(array)
    if not good.all():
        bad = int(np.flatnonzero(~good)[0])
        place, value = _place(column.name, bad), float(array[bad])
        raise NonFiniteError(path, place, value, "a finite number")
