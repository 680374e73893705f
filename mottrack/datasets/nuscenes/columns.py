"""Records of a table to checked arrays, a block at a time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.errors import DataError
from mottrack.formats.nuscenes_tables import Row

BLOCK_ROWS = 20_000


@dataclass(frozen=True)
class Kind:
    """What a field must hold: `width` numbers (0: one), integers only, or text."""

    name: str
    width: int = 0
    integer: bool = False
    text: bool = False

    @property
    def expected(self) -> str:
        """The words for an error message."""
        if self.text:
            return "text"
        what = "integer" if self.integer else "number"
        return f"{self.width} finite {what}s" if self.width else f"a finite {what}"

    def array(self, values: list[Any]) -> NDArray[Any] | None:
        """Return the values as an array, or None if one of them is of another kind."""
        if self.text:
            if not all(isinstance(value, str) for value in values):
                return None
            return np.array([value.encode() for value in values], dtype=np.bytes_)
        shape = (len(values), self.width) if self.width else (len(values),)
        try:
            array = np.array(values)
        except ValueError:
            return None
        if array.shape != shape or array.dtype.kind not in ("iub" if self.integer else "iuf"):
            return None
        if not np.isfinite(array).all():
            return None
        return array.astype(np.int64 if self.integer else np.float64)

    def empty(self) -> NDArray[Any]:
        """Return the array of no values."""
        dtype: Any = np.bytes_ if self.text else np.int64 if self.integer else np.float64
        return np.zeros((0, self.width) if self.width else (0,), dtype=dtype)


def collect(path: Path, rows: Iterable[Row], kinds: tuple[Kind, ...]) -> dict[str, NDArray[Any]]:
    """Return one array for each kind; text as bytes, which take a quarter of the memory.

    Raises:
        DataError: a record lacks a field or holds another kind of value.

    """
    parts: dict[str, list[NDArray[Any]]] = {kind.name: [kind.empty()] for kind in kinds}
    iterator = iter(rows)
    while block := list(islice(iterator, BLOCK_ROWS)):
        for kind in kinds:
            parts[kind.name].append(_column(path, block, kind))
    return {name: np.concatenate(arrays) for name, arrays in parts.items()}


def _column(path: Path, block: list[Row], kind: Kind) -> NDArray[Any]:
    array = kind.array([row.get(kind.name) for row in block])
    if array is None:
        bad = next(row for row in block if kind.array([row.get(kind.name)]) is None)
        where = f"{kind.name} of record {bad.get('token', '?')}"
        raise DataError(path, where, bad.get(kind.name, "missing"), kind.expected)
    return array
