"""Tables of one version, streamed into arrays of the records that are wanted."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import I64, Mask
from mottrack.core.errors import DataError
from mottrack.datasets.faults import NotRigidError, OutOfOrderError
from mottrack.datasets.nuscenes.columns import Kind, collect
from mottrack.datasets.rigid import MAX_DEFECT, MAX_PLACE_M, quaternion_length
from mottrack.formats.nuscenes_tables import (
    Row,
    Thinning,
    records_with,
    stream_table,
    table_path,
)

Columns = dict[str, NDArray[Any]]
TOKEN = Kind("token", text=True)
ROTATION, TRANSLATION = Kind("rotation", 4), Kind("translation", 3)


@dataclass(frozen=True)
class Expected:
    """What a field must hold, and which error says so."""

    name: str
    expected: str
    error: type[DataError] = DataError


UNIT_ROTATION = Expected("rotation", "a unit quaternion", NotRigidError)
NEAR_PLACE = Expected("translation", f"within {MAX_PLACE_M:g} m")
ONE_NAME = Expected("name", "each name once", OutOfOrderError)


@dataclass(frozen=True)
class Tables:
    """The folder of tables of one version."""

    root: Path
    version: str

    def path(self, name: str) -> Path:
        """File of a table; raises DataError when it is missing."""
        return table_path(self.root, self.version, name)

    def rows(self, name: str) -> Iterator[Row]:
        """All records of a table."""
        return stream_table(self.path(name))

    def columns(self, name: str, kinds: tuple[Kind, ...], among: Rows | None = None) -> Columns:
        """The records of a table as arrays; `among` keeps those whose fields are in its sets."""
        path = self.path(name)
        if among is None:
            return collect(path, stream_table(path), kinds)
        rows = stream_table(path, thin=among.thinning())
        return collect(path, (row for row in rows if among.holds(row)), kinds)

    def refuse(self, name: str, columns: Columns, wrong: Mask, field: Expected) -> None:
        """Raise DataError that names the first record (it has a token) where `wrong` (N,)."""
        rows = np.flatnonzero(wrong)
        if rows.size:
            where = f"{field.name} of record {columns['token'][rows[0]].decode()}"
            value = columns[field.name][rows[0]].tolist()
            shown = value.decode() if isinstance(value, bytes) else value
            raise field.error(self.path(name), where, shown, field.expected)

    def check_poses(self, name: str, columns: Columns) -> None:
        """Raise DataError for a rotation that is no unit quaternion, or a place far from Earth."""
        off = np.abs(quaternion_length(columns["rotation"]) - 1.0) > MAX_DEFECT
        self.refuse(name, columns, off, UNIT_ROTATION)
        far = np.abs(columns["translation"]).max(axis=1, initial=0.0) > MAX_PLACE_M
        self.refuse(name, columns, far, NEAR_PLACE)

    def scene_tokens(self) -> dict[str, str]:
        """Token of each scene by name, in the order of the table; DataError for a name twice."""
        scenes = self.columns("scene", (TOKEN, Kind("name", text=True)))
        repeated = np.ones(len(scenes["name"]), dtype=bool)
        repeated[np.unique(scenes["name"], return_index=True)[1]] = False
        self.refuse("scene", scenes, repeated, ONE_NAME)
        return dict(zip(text_of(scenes["name"]), text_of(scenes["token"]), strict=True))


@dataclass(frozen=True)
class Rows:
    """Which records of a table are wanted: each named field has a value in its set.

    The first field is the one that spares parsing, so it should be the choosiest.
    """

    wanted: Mapping[str, Collection[str]]

    def thinning(self) -> Thinning:
        """What drops most of the others before they are parsed."""
        name, values = next(iter(self.wanted.items()))
        return records_with(name, frozenset(value.encode() for value in values))

    def holds(self, row: Row) -> bool:
        """Whether the record is one of them; one without the field is not."""
        for name, values in self.wanted.items():
            value = row.get(name)
            if not isinstance(value, str) or value not in values:
                return False
        return True


def text_of(values: NDArray[np.bytes_]) -> list[str]:
    """Return stored text as strings."""
    return [value.decode() for value in values.tolist()]


def looked_up(tokens: NDArray[np.bytes_], index: dict[str, int]) -> I64:
    """Return the index of each token, all of which are in `index`."""
    return np.array([index[token] for token in text_of(tokens)], dtype=np.int64)
