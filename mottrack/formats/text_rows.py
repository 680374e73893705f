"""Rows of values in text files (KITTI, MOTChallenge, csv): a fault names the file and the line.

One parser for all of them. It takes plain decimal numbers alone: Python's own would also take
`1_000`, digits of other scripts, `nan` and `infinity`.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.errors import DataError
from mottrack.core.limits import MAX_ROWS
from mottrack.formats.columns import Columns, ColumnSpec
from mottrack.formats.faults import NonFiniteError
from mottrack.formats.files import read_text

_INTEGER = re.compile(r"[-+]?[0-9]{1,25}")
"""64 bits need 19 digits; the others leave room for leading zeros."""
_INT64 = np.iinfo(np.int64)
EXACT_INTEGERS = 2**53
"""Below it every integer has a float64 of its own."""
_NUMERIC = {ord(character): None for character in "0123456789.+-eE, \n"}
"""What plain numbers are written with: none of `nan`, `inf`, `0x1` or `1_000`."""
_MISSING = (",,", ",\n", "\n,", "\n\n")
"""Two ends of a value without one between them: it is missing, or the line is blank."""
_DECIMAL_COMMA = re.compile(r"[-+]?[0-9]+,[0-9]+")


def read_lines(path: Path) -> list[str]:
    """Return the lines of a UTF-8 text file.

    Raises:
        DataError: the file can not be read, or is not text.
    """
    return _split_lines(read_text(path))


def _split_lines(text: str) -> list[str]:
    return text.removesuffix("\n").split("\n") if text else []


@dataclass(frozen=True)
class Layout:
    """How the values stand in a line.

    separator: between values; None: white space. "," takes white space for lines without commas
        where `loose` is set.
    optional: so many further values a row are allowed and ignored, the same number in each.
    header: the first line holds the names of the columns, separated by commas.
    loose: commas where there are any, else white space (MOTChallenge has both).
    """

    separator: str | None = None
    optional: int = 0
    header: bool = False
    loose: bool = False


WHITE_SPACE = Layout()


def read_text_columns(
    path: Path, columns: tuple[ColumnSpec, ...], layout: Layout = WHITE_SPACE
) -> Columns:
    """Read one row of single values from each line; blank lines are skipped.

    Args:
        path: the file.
        columns: what each row holds, from left to right; those at the end that have a default
            may be left out, by all rows alike.
        layout: how the values stand in a line.

    Raises:
        DataError: a row with too few or too many values or of another length than the first, an
            empty value, or one that is not a finite number, with the line and the column.
    """
    text = read_text(path)
    table = _plain_table(text, columns, layout)
    if table is not None:
        return _columns_of(path, table, columns)
    lines = _split_lines(text)
    if layout.header:
        _check_header(path, lines, columns)
    numbers = [n for n, line in enumerate(lines, 1) if line.strip()][int(layout.header) :]
    if len(numbers) > MAX_ROWS.value:
        raise DataError(path, "rows", len(numbers), MAX_ROWS.expected("rows"))
    fields = [_fields(lines[n - 1], layout) for n in numbers]
    count = _common_length(path, numbers, fields, columns, layout)
    arrays = {}
    for i, spec in enumerate(columns):
        if i < count:
            arrays[spec.name] = _column(path, numbers, [row[i] for row in fields], spec)
        else:
            arrays[spec.name] = spec.array([spec.default] * len(numbers))
    return Columns(path, arrays, np.array(numbers, dtype=np.int64), _place)


def _plain_table(text: str, columns: tuple[ColumnSpec, ...], layout: Layout) -> F64 | None:
    """Return all values of a text that is nothing but numbers and commas, (rows, values a row).

    None where a line is blank, a value is missing, or anything else would need a closer look.
    """
    if layout.header or not layout.loose or any(spec.kind is not float for spec in columns):
        return None
    content = text.removesuffix("\n")
    if not content or content.translate(_NUMERIC) or _misses_value(content.replace(" ", "")):
        return None
    codes = np.frombuffer(content.encode(), np.uint8)
    ends = np.append(np.flatnonzero(codes == ord("\n")), len(codes))
    commas = np.diff(np.searchsorted(np.flatnonzero(codes == ord(",")), ends), prepend=0)
    rows, count = len(ends), int(commas[0]) + 1
    least = sum(spec.default is None for spec in columns)
    if (commas != commas[0]).any() or not least <= count <= len(columns) + layout.optional:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # that the text ends early is a warning in some versions
            values = np.fromstring(content.replace(",", " "), np.float64, sep=" ")
    except (DeprecationWarning, ValueError):
        return None
    if len(values) != rows * count or rows > MAX_ROWS.value or not np.isfinite(values).all():
        return None
    return values.reshape(rows, count)


def _misses_value(text: str) -> bool:
    """Return whether a value is missing or a line blank in a text without spaces."""
    ends = "," in (text[:1], text[-1:]) or "\n" in (text[:1], text[-1:])
    return ends or any(pair in text for pair in _MISSING)


def _columns_of(path: Path, table: F64, columns: tuple[ColumnSpec, ...]) -> Columns:
    rows, count = table.shape
    arrays = {
        spec.name: np.ascontiguousarray(table[:, i])
        if i < count
        else spec.array([spec.default] * rows)
        for i, spec in enumerate(columns)
    }
    return Columns(path, arrays, np.arange(1, rows + 1), _place)


def _fields(line: str, layout: Layout) -> list[str]:
    separator = "," if layout.loose and "," in line else layout.separator
    return line.split() if separator is None else line.split(separator)


def _common_length(
    path: Path,
    numbers: list[int],
    fields: list[list[str]],
    columns: tuple[ColumnSpec, ...],
    layout: Layout,
) -> int:
    """Return how many values each row has; refuse a row with another number of them."""
    if not fields:
        return len(columns)
    least = sum(spec.default is None for spec in columns)
    most = len(columns) + layout.optional
    count = len(fields[0])
    for number, row in zip(numbers, fields, strict=True):
        if not least <= len(row) <= most:
            names = f"{columns[0].name} .. {columns[least - 1].name}"
            hint = "; a decimal comma makes two values of one" if len(row) > most else ""
            expected = f"{least} values ({names}){hint or _comma_hint(row)}"
            raise DataError(path, f"line {number}", f"{len(row)} values", expected)
        if len(row) != count:
            expected = f"{count} as in line {numbers[0]}"
            raise DataError(path, f"line {number}", f"{len(row)} values", expected)
    return count


def _comma_hint(row: list[str]) -> str:
    return "; decimals with a point" if any(map(_DECIMAL_COMMA.fullmatch, row)) else ""


def _place(name: str, line: int) -> str:
    return f"line {line}, {name}"


def _check_header(path: Path, lines: list[str], columns: tuple[ColumnSpec, ...]) -> None:
    expected = ",".join(column.name for column in columns)
    found = lines[0].replace(" ", "") if lines else ""
    if found != expected:
        raise DataError(path, "line 1", repr(found), f"the header {expected}")


def _column(path: Path, numbers: list[int], texts: list[str], spec: ColumnSpec) -> Any:
    """Return the values of a column, all at once where none is at fault."""
    if spec.kind is str:
        stripped = [text.strip() for text in texts]
        _refuse_empty(path, numbers, stripped, spec)
        return spec.array(stripped)
    if spec.blank is not None:
        return _with_blanks(path, numbers, texts, spec)
    try:
        values = list(map(float if spec.kind is float else int, texts))
        joined = "".join(texts)
        plain = "_" not in joined and joined.isascii()
    except (ValueError, OverflowError):
        plain = False
    if plain and spec.kind is float and all(map(math.isfinite, values)):
        return spec.array(values)
    if plain and spec.kind is int and all(_INT64.min <= v <= _INT64.max for v in values):
        return spec.array(values)
    parse: Callable[[Path, str, str], float] = _integer if spec.kind is int else _number
    return spec.array(
        [parse(path, _place(spec.name, n), t.strip()) for n, t in zip(numbers, texts, strict=True)]
    )


def _with_blanks(path: Path, numbers: list[int], texts: list[str], spec: ColumnSpec) -> Any:
    """Return numbers of a column in which cells may be empty."""
    values = [spec.blank] * len(texts)
    for row, (number, text) in enumerate(zip(numbers, texts, strict=True)):
        if text.strip():
            values[row] = _number(path, _place(spec.name, number), text.strip())
    return spec.array(values)


def _refuse_empty(path: Path, numbers: list[int], texts: list[str], spec: ColumnSpec) -> None:
    for number, text in zip(numbers, texts, strict=True):
        if not text:
            raise DataError(path, _place(spec.name, number), "empty", spec.expected)


def _integer(path: Path, where: str, text: str) -> int:
    if not _INTEGER.fullmatch(text) or not _INT64.min <= int(text) <= _INT64.max:
        raise DataError(path, where, text or "empty", "an integer of 64 bits")
    return int(text)


def _number(path: Path, where: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        expected = "a number" + _comma_hint([text])
        raise DataError(path, where, text or "empty", expected) from error
    if "_" in text or not text.isascii():
        raise DataError(path, where, text, "a number in plain digits")
    if not math.isfinite(value):
        raise NonFiniteError(path, where, text, "a finite number, neither NaN nor infinity")
    return value


def finite_values(path: Path, where: str, texts: list[str]) -> list[float]:
    """Return texts as finite numbers; raise `DataError` that says `where` for another one."""
    return [_number(path, where, text) for text in texts]


def check_whole(table: Columns, *names: str) -> None:
    """Raise `DataError` for the first value of columns of numbers that is no whole number."""
    for name in names:
        values = table[name]
        exact = (values == np.floor(values)) & (np.abs(values) < EXACT_INTEGERS)
        table.refuse(name, ~exact, "a whole number")
