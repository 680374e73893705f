"""Files of a data set: paths that stay inside the root, checked reading, atomic writing.

Every fault that a file can have becomes a `DataError` that names the file, the field and the value.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F32, I64, Floats, Mask
from mottrack.core.errors import DataError
from mottrack.datasets.faults import MissingError, NonFiniteError, OutsideRootError, TruncatedError

MAX_RANGE_M = 2_000.0
"""No LiDAR sees farther; a coordinate beyond it is a damaged file, not a return."""
MAX_BOX_RANGE_M = 1_000.0
"""No detector and no annotator sees farther from the vehicle."""
MAX_BOX_SIZE_M = 100.0
MAX_ANGLE_RAD = 4.0 * np.pi
"""Headings may be unwrapped; a larger one is in degrees, or damaged."""
_INTEGER = re.compile(r"[-+]?[0-9]+")
_INT64 = np.iinfo(np.int64)


def inside(root: Path, relative: str, *, follow_links: bool = False) -> Path:
    """Return `root / relative`; refuse a name that leaves the root.

    Names come from the files of a data set, so they are not trusted: absolute names and `..` are
    refused, and so are links that point outside unless `follow_links` says that they are the
    user's own (data sets are often spread over several disks that way).

    Raises:
        DataError: the path escapes the root.

    """
    path = root / relative
    plain = not Path(relative).is_absolute() and ".." not in Path(relative).parts
    if not plain or "\0" in relative:
        raise OutsideRootError(root, "path", relative, "a path inside the data root")
    if not follow_links and not path.resolve().is_relative_to(root.resolve()):
        raise OutsideRootError(path, "link", str(path.resolve()), "a target inside the data root")
    return path


def existing_folder(path: Path, field: str) -> Path:
    """Return `path` if it is a folder that is not empty, else raise `DataError`."""
    if not path.is_dir():
        raise MissingError(path, field, "missing", "a folder")
    if next(path.iterdir(), None) is None:
        raise MissingError(path, field, "empty folder", "a folder with data")
    return path


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a file; an unreadable or missing one is a `DataError`."""
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise MissingError(path, "file", "missing", "a file of the data set") from error
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise DataError(path, "file", f"unreadable ({reason})", "a readable file") from error


def read_text(path: Path) -> str:
    """Return a UTF-8 text file without its byte order mark; other bytes are a `DataError`."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(path, "byte", error.start, "UTF-8 text") from error


def read_floats(path: Path, columns: int) -> F32:
    """Return a raw little-endian float32 file as (N, columns), every value finite.

    Raises:
        DataError: the file is missing, empty or cut inside a row, or a value is not finite.

    """
    data = read_bytes(path)
    row_bytes = 4 * columns
    if not data or len(data) % row_bytes:
        expected = f"a positive multiple of {row_bytes} ({columns} float32 a point)"
        raise TruncatedError(path, "size in bytes", len(data), expected)
    values = np.frombuffer(data, dtype="<f4").reshape(-1, columns).astype(np.float32)
    check_finite(path, values)
    return values


def check_finite(path: Path, values: Floats) -> None:
    """Raise `DataError` naming the first row of (N, C) `values` that is not finite."""
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if bad.size:
        raise NonFiniteError(path, f"point {bad[0]}", values[bad[0]].tolist(), "finite values")


def check_range(path: Path, xyz_m: Floats) -> None:
    """Raise `DataError` naming the first of (N, 3) points farther than a LiDAR can see."""
    bad = np.flatnonzero(np.abs(xyz_m).max(axis=1, initial=0.0) > MAX_RANGE_M)
    if bad.size:
        raise DataError(path, f"point {bad[0]}", xyz_m[bad[0]].tolist(), f"within {MAX_RANGE_M} m")


def check_unit_interval(path: Path, reflectance: Floats) -> None:
    """Raise `DataError` naming the first reflectance outside [0, 1]."""
    bad = np.flatnonzero((reflectance < 0.0) | (reflectance > 1.0))
    if bad.size:
        raise DataError(path, f"reflectance {bad[0]}", float(reflectance[bad[0]]), "in [0, 1]")


@dataclass(frozen=True)
class Column:
    """One column of a text table: its name in error messages and what a value must be."""

    name: str
    kind: type[int] | type[float] | type[str] = float


def read_table(
    path: Path,
    columns: tuple[Column, ...],
    *,
    separator: str | None = None,
    optional: int = 0,
    header: bool = False,
) -> dict[str, NDArray[Any]]:
    """Read rows of text as one array a column, and `line`, where each row stood.

    Blank lines are skipped. Up to `optional` further values a row are allowed and ignored. With
    `header` the first line holds the names of the columns.

    Raises:
        DataError: a row with too few or too many values, or a value that is not a finite number,
            with the line and the column in the message.

    """
    rows: list[list[Any]] = []
    lines: list[int] = []
    text = read_text(path).splitlines()
    if header:
        _check_header(path, text, columns)
    for number, line in enumerate(text, start=1):
        if line.strip() and not (header and number == 1):
            fields = [field.strip() for field in line.strip().split(separator)]
            if not len(columns) <= len(fields) <= len(columns) + optional:
                raise DataError(path, f"line {number}", f"{len(fields)} values", _count(columns))
            rows.append(_parse_row(path, number, fields, columns))
            lines.append(number)
    table = {c.name: _as_array([row[i] for row in rows], c) for i, c in enumerate(columns)}
    return table | {"line": np.array(lines, dtype=np.int64)}


def refuse_rows(
    path: Path, table: dict[str, NDArray[Any]], wrong: Mask, name: str, expected: str
) -> None:
    """Raise `DataError` naming line, column and value of the first row where `wrong` (N,)."""
    rows = np.flatnonzero(wrong)
    if rows.size:
        value = table[name][rows[0]].item()
        raise DataError(path, f"line {table['line'][rows[0]]}, {name}", value, expected)


def check_boxes(
    path: Path,
    table: dict[str, NDArray[Any]],
    size: tuple[str, ...],
    place: tuple[str, ...],
    heading: str,
) -> None:
    """Raise `DataError` for the first box whose size, place or heading is out of range.

    Args:
        path: file of the table.
        table: columns (N,) in metres and radians, as `read_table` returns them.
        size: names of length, width and height.
        place: names of the coordinates about the vehicle.
        heading: name of the angle.

    """
    for name in size:
        wrong = (table[name] <= 0.0) | (table[name] > MAX_BOX_SIZE_M)
        refuse_rows(path, table, wrong, name, f"in (0, {MAX_BOX_SIZE_M:g}] m")
    for name in place:
        too_far = np.abs(table[name]) > MAX_BOX_RANGE_M
        refuse_rows(path, table, too_far, name, f"within {MAX_BOX_RANGE_M:g} m of the vehicle")
    turned = np.abs(table[heading]) > MAX_ANGLE_RAD
    refuse_rows(path, table, turned, heading, "radians, at most two turns")


def repeated_rows(keys: I64) -> Mask:
    """Return (N,) whether a row of (N, K) `keys` stands before already."""
    repeated = np.ones(len(keys), dtype=bool)
    repeated[np.unique(keys, axis=0, return_index=True)[1]] = False
    return repeated


def _check_header(path: Path, text: list[str], columns: tuple[Column, ...]) -> None:
    expected = ",".join(column.name for column in columns)
    found = text[0].replace(" ", "") if text else ""
    if found != expected:
        raise DataError(path, "line 1", repr(found), f"the header {expected}")


def _count(columns: tuple[Column, ...]) -> str:
    return f"{len(columns)} values ({columns[0].name} .. {columns[-1].name})"


def _as_array(values: list[Any], column: Column) -> NDArray[Any]:
    dtype: Any = {int: np.int64, float: np.float64, str: np.str_}[column.kind]
    return np.array(values, dtype=dtype)


def _parse_row(
    path: Path, number: int, fields: list[str], columns: tuple[Column, ...]
) -> list[int | float | str]:
    row: list[int | float | str] = []
    for field, column in zip(fields, columns, strict=False):
        row.append(_parse(path, f"line {number}, {column.name}", field, column))
    return row


def _parse(path: Path, where: str, text: str, column: Column) -> int | float | str:
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
        raise NonFiniteError(path, where, text, "a finite number")
    return value
