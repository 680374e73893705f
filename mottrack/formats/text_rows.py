"""Rows of values in text files (KITTI, MOTChallenge, csv): a fault names the file and the line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.errors import DataError
from mottrack.formats.columns import Columns, ColumnSpec
from mottrack.formats.faults import NonFiniteError
from mottrack.formats.files import read_text

_INTEGER = re.compile(r"[-+]?[0-9]{1,25}")
"""64 bits need 19 digits; the others leave room for leading zeros."""
_INT64 = np.iinfo(np.int64)
EXACT_INTEGERS = 2**53
"""Below it every integer has a float64 of its own."""


def read_lines(path: Path) -> list[str]:
    """Return the lines of a UTF-8 text file.

    Raises:
        DataError: the file can not be read, or is not text.
    """
    return read_text(path).splitlines()


def read_text_columns(
    path: Path,
    columns: tuple[ColumnSpec, ...],
    *,
    separator: str | None = None,
    optional: int = 0,
    header: bool = False,
) -> Columns:
    """Read one row of single values from each line; blank lines are skipped.

    Args:
        path: the file.
        columns: what each row holds, from left to right.
        separator: between values; None: white space.
        optional: so many further values a row are allowed and ignored.
        header: the first line holds the names of the columns, separated by commas.

    Raises:
        DataError: a row with too few or too many values, or a value that is not a finite number,
            with the line and the column in the message.
    """
    lines = read_lines(path)
    if header:
        _check_header(path, lines, columns)
    numbers = [n for n, line in enumerate(lines, 1) if line.strip() and not (header and n == 1)]
    rows: list[list[Any]] = []
    for number in numbers:
        fields = [field.strip() for field in lines[number - 1].strip().split(separator)]
        if not len(columns) <= len(fields) <= len(columns) + optional:
            expected = f"{len(columns)} values ({columns[0].name} .. {columns[-1].name})"
            raise DataError(path, f"line {number}", f"{len(fields)} values", expected)
        pairs = zip(fields, columns, strict=False)
        rows.append([_value(path, _place(spec.name, number), text, spec) for text, spec in pairs])
    arrays = {spec.name: spec.array([row[i] for row in rows]) for i, spec in enumerate(columns)}
    return Columns(path, arrays, np.array(numbers, dtype=np.int64), _place)


def finite_numbers(path: Path, line: int, fields: Sequence[str]) -> list[float]:
    """Return the fields of a line as numbers, the first two of which, frame and id, are whole.

    Raises:
        DataError: a field is no finite number, or the frame or the identity has a fraction.
    """
    numbers = [_number(path, f"line {line}", field) for field in fields]
    for name, number in zip(("frame", "id"), numbers, strict=False):
        if not (number.is_integer() and abs(number) < EXACT_INTEGERS):
            raise DataError(path, _place(name, line), number, "a whole number")
    return numbers


def _place(name: str, line: int) -> str:
    return f"line {line}, {name}"


def _check_header(path: Path, lines: list[str], columns: tuple[ColumnSpec, ...]) -> None:
    expected = ",".join(column.name for column in columns)
    found = lines[0].replace(" ", "") if lines else ""
    if found != expected:
        raise DataError(path, "line 1", repr(found), f"the header {expected}")


def _value(path: Path, where: str, text: str, column: ColumnSpec) -> int | float | str:
    if column.kind is str:
        return text
    return _integer(path, where, text) if column.kind is int else _number(path, where, text)


def _integer(path: Path, where: str, text: str) -> int:
    if not _INTEGER.fullmatch(text) or not _INT64.min <= int(text) <= _INT64.max:
        raise DataError(path, where, text, "an integer of 64 bits")
    return int(text)


def _number(path: Path, where: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise DataError(path, where, text, "a number") from error
    if not np.isfinite(value):
        raise NonFiniteError(path, where, text, "a finite number, neither NaN nor infinity")
    return value
