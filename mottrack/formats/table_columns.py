"""Large tables of records straight into columns: no record becomes a Python object.

The text is thinned as in `table_stream`, cut into one line a record, and Arrow's JSON reader makes
columns of it, a block at a time. Where anything is not as expected, a value of another kind, a
field that is missing, text beyond printable ASCII, nothing is decided here: the caller reads the
table record by record, which names the fault and its place.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.formats.columns import ColumnSpec
from mottrack.formats.table_stream import RecordCount, RecordFilter, Thinned, array_blocks

LARGE_BYTES = 2**24
"""From 16 MiB on it saves more time than the import of pyarrow takes."""
_BLOCK_BYTES = 2**22
"""Text that becomes columns at a time: some 10,000 records; small beside other memory."""
_BETWEEN_RECORDS = re.compile(rb"\}\s*,\s*\{")
_PRINTABLE = (0x20, 0x7E)
"""First and last printable character of ASCII."""

Arrays = dict[str, NDArray[Any]]


class UnclearError(Exception):
    """Something that is left to the reader of single records."""


def large_columns(path: Path, specs: tuple[ColumnSpec, ...], among: RecordFilter) -> Arrays | None:
    """Return fields of the wanted records as arrays, text as bytes; None where that is unclear.

    Args:
        path: file with an array of records.
        specs: the fields.
        among: which records; counts all of them where the answer is not None.
    """
    if path.stat().st_size < LARGE_BYTES or among.needs_each_record:
        return None
    import pyarrow as pa

    count, thin = RecordCount(), among.thinning()
    blocks = (thin(text) for text in array_blocks(path, _BLOCK_BYTES))
    try:
        parts = [_columns(thinned, specs, among, count) for thinned in blocks]
    except (ValueError, OverflowError, RecursionError, pa.ArrowException, UnclearError):
        return None
    among.count.records += count.records
    return {spec.name: np.concatenate([part[spec.name] for part in parts]) for spec in specs}


def _columns(
    thinned: Thinned, specs: tuple[ColumnSpec, ...], among: RecordFilter, count: RecordCount
) -> Arrays:
    """Return the columns of one block, which is an array of whole records."""
    if among.wanted and not thinned.exact:
        raise UnclearError
    lines = _lines(thinned)
    records = thinned.text.count(b"}")
    count.records += thinned.dropped + records
    table = _parsed(lines, specs)
    if table.num_rows != records:
        raise UnclearError
    return {spec.name: _array(table[spec.name].combine_chunks(), spec) for spec in specs}


def _lines(thinned: Thinned) -> bytes:
    """Return one line a record."""
    text = thinned.text.strip()
    if not (text.startswith(b"[") and text.endswith(b"]")):
        raise UnclearError
    if b"\n" in text:
        text = text.replace(b"\n", b" ")
    between = _BETWEEN_RECORDS.search(text)
    if between is not None:
        # one separator throughout is replaced faster than a pattern
        text = text.replace(between.group(), b"}\n{")
        if b"}," in text or b"} " in text:
            text = _BETWEEN_RECORDS.sub(b"}\n{", text)
    return text[1:-1]


def _parsed(lines: bytes, specs: tuple[ColumnSpec, ...]) -> Any:
    import pyarrow as pa
    import pyarrow.json

    schema = pa.schema([(spec.name, _type_of(spec)) for spec in specs])
    if not lines.strip():
        return schema.empty_table()
    return pyarrow.json.read_json(
        pa.BufferReader(lines),
        pyarrow.json.ReadOptions(use_threads=False, block_size=len(lines) + 1),
        pyarrow.json.ParseOptions(explicit_schema=schema, unexpected_field_behavior="ignore"),
    )


def _type_of(spec: ColumnSpec) -> Any:
    import pyarrow as pa

    kinds = {str: pa.string(), int: pa.int64(), float: pa.float64()}
    if spec.kind not in kinds:
        raise UnclearError
    kind = kinds[spec.kind]
    return pa.list_(kind) if spec.width else kind


def _array(values: Any, spec: ColumnSpec) -> NDArray[Any]:
    if values.null_count:
        raise UnclearError
    if spec.kind is str:
        return _texts(values)
    if spec.width:
        lengths = np.diff(numbers_of(values.offsets, np.int32))
        if (lengths != spec.width).any() or values.flatten().null_count:
            raise UnclearError
        values = values.flatten()
    array = numbers_of(values, np.int64 if spec.kind is int else np.float64)
    if not np.isfinite(array).all():
        raise UnclearError
    return array.reshape(-1, spec.width) if spec.width else array


def numbers_of(values: Any, kind: type[np.generic]) -> NDArray[Any]:
    """Return an Arrow array of numbers, none of them missing, without a copy.

    Its own `to_numpy` imports pandas, which takes longer than a small file.
    """
    numbers = np.frombuffer(values.buffers()[1] or b"", kind)
    return numbers[values.offset : values.offset + len(values)]


def _texts(values: Any) -> NDArray[np.bytes_]:
    """Return an Arrow array of text as bytes of fixed length."""
    if not len(values):
        return np.zeros(0, np.bytes_)
    _, edges, content = values.buffers()
    offsets = np.frombuffer(edges, np.int32)[values.offset : values.offset + len(values) + 1]
    characters = np.frombuffer(content, np.uint8)[offsets[0] : offsets[-1]] if content else _NONE
    if ((characters < _PRINTABLE[0]) | (characters > _PRINTABLE[1])).any():
        raise UnclearError
    length = np.diff(offsets)
    width = max(int(length.max()), 1)
    padded = np.zeros((len(length), width), np.uint8)
    padded[np.arange(width) < length[:, None]] = characters
    texts: NDArray[np.bytes_] = padded.view(f"S{width}").ravel()
    return texts


_NONE = np.zeros(0, np.uint8)
"""The characters of texts that are all empty."""
