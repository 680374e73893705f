"""Rows of a file as checked arrays: what text, feather and nuScenes tables are read into."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, Mask
from mottrack.core.errors import DataError
from mottrack.formats.faults import OutOfOrderError

_DTYPES: dict[type, Any] = {int: np.int64, float: np.float64, str: np.str_, bool: np.bool_}


@dataclass(frozen=True)
class ColumnSpec:
    """What a column must hold.

    name: as the file and error messages call it.
    kind: integers of 64 bits, finite numbers, text, or true and false.
    width: length of the list of numbers in each row; 0 for a single value.
    default: the value where rows of a text file end before this column; None: they must not.
    blank: the value of an empty cell of a table, NaN for "not known"; None: there must be none.
    """

    name: str
    kind: type[int] | type[float] | type[str] | type[bool] = float
    width: int = 0
    default: float | None = None
    blank: float | None = None

    @property
    def expected(self) -> str:
        """What a value must be, for an error message."""
        if self.kind is bool:
            return "true or false"
        if self.kind is str:
            return "text without control characters"
        what = "integer" if self.kind is int else "number"
        return f"{self.width} finite {what}s" if self.width else f"a finite {what}"

    def array(self, values: list[Any]) -> NDArray[Any]:
        """Return checked values as an array of the column's own type."""
        shape = (-1, self.width) if self.width else (-1,)
        return np.array(values, dtype=_DTYPES[self.kind]).reshape(shape)


def specs(*names: str) -> tuple[ColumnSpec, ...]:
    """Return the specification of columns of finite numbers."""
    return tuple(ColumnSpec(name) for name in names)


@dataclass(frozen=True)
class Columns:
    """N rows of a file, one array per column.

    path: the file.
    arrays: (N,) or (N, width) by name.
    row: (N,) what error messages call each row: its line, its number or its token.
    place: the words for a value in an error message, from its column's name and its `row`.
    """

    path: Path
    arrays: Mapping[str, NDArray[Any]]
    row: NDArray[Any]
    place: Callable[[str, Any], str]

    def __len__(self) -> int:
        return len(self.row)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.arrays[name]

    def select(self, index: NDArray[Any]) -> Columns:
        """Return the rows that a mask or an index picks."""
        arrays = {name: values[index] for name, values in self.arrays.items()}
        return Columns(self.path, arrays, self.row[index], self.place)

    def extended(self, **arrays: NDArray[Any]) -> Columns:
        """Return the same rows with further columns."""
        return Columns(self.path, {**self.arrays, **arrays}, self.row, self.place)

    def stacked(self, names: tuple[str, ...]) -> F64:
        """Return single-valued columns side by side, (N, len(names))."""
        return np.column_stack([self.arrays[name] for name in names])

    def refuse(
        self, name: str, wrong: Mask, expected: str, error: type[DataError] = DataError
    ) -> None:
        """Raise `error` with place and value of the first row where `wrong` (N,) or (N, K)."""
        rows = np.flatnonzero(wrong if wrong.ndim == 1 else wrong.any(axis=1))
        if rows.size:
            value = self.arrays[name][rows[0]].tolist()
            shown = value.decode(errors="replace") if isinstance(value, bytes) else value
            raise error(self.path, self.place(name, self.row[rows[0]]), shown, expected)

    def refuse_repeated(self, name: str, keys: NDArray[Any], expected: str) -> None:
        """Raise `OutOfOrderError` if a key, an element (N,) or a row (N, K), is there already."""
        listed = keys.tolist() if keys.ndim == 1 else map(tuple, keys.tolist())
        if len(set(listed)) == len(self):
            return  # a set is made in a third of the time of sorting
        repeated = np.ones(len(self), dtype=bool)
        axis = None if keys.ndim == 1 else 0
        repeated[np.unique(keys, axis=axis, return_index=True)[1]] = False
        self.refuse(name, repeated, expected, OutOfOrderError)
