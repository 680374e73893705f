"""Tables of a data set in nuScenes format, read in bounded memory.

A table is a JSON array of flat records (`sample.json`, `ego_pose.json`, ...). Only the records that
are asked for are kept, as dictionaries or as checked columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import I64
from mottrack.core.errors import DataError
from mottrack.formats.columns import Columns, ColumnSpec
from mottrack.formats.files import inside, present
from mottrack.formats.table_columns import large_columns
from mottrack.formats.table_stream import EVERY_RECORD, RecordFilter, Row, wanted_records

_BLOCK_ROWS = 20_000
"""Records held as dictionaries before they become arrays: about 20 MB."""

TOKEN = ColumnSpec("token", str)
# quaternions w, x, y, z and positions x, y, z
ROTATION = ColumnSpec("rotation", width=4)
TRANSLATION = ColumnSpec("translation", width=3)


@dataclass(frozen=True)
class NuScenesTables:
    """The folder of tables of one version."""

    root: Path
    version: str

    def path(self, name: str) -> Path:
        """Return the file of a table; raise DataError when it is missing."""
        return table_path(self.root, self.version, name)

    def rows(self, name: str, among: RecordFilter = EVERY_RECORD) -> Iterator[Row]:
        """Yield the wanted records of a table, all of them by default, in the order of the file."""
        return wanted_records(self.path(name), among)

    def columns(
        self, name: str, specs: tuple[ColumnSpec, ...], among: RecordFilter = EVERY_RECORD
    ) -> Columns:
        """Return the wanted records as arrays, text as bytes, which take a quarter of the memory.

        Raises:
            DataError: a record lacks a field or holds a value of another kind.
        """
        path = self.path(name)
        arrays = large_columns(path, specs, among) or self._arrays(name, specs, among)
        count = len(arrays[specs[0].name])
        table = Columns(path, arrays, arrays.get("token", np.arange(count)), _place)
        if "token" in arrays:
            table.refuse_repeated("token", arrays["token"], "each token once")
        return table

    def _arrays(
        self, name: str, specs: tuple[ColumnSpec, ...], among: RecordFilter
    ) -> dict[str, NDArray[Any]]:
        path, rows = self.path(name), self.rows(name, among)
        parts = [json_arrays(path, [], specs, _place)]
        while block := list(islice(rows, _BLOCK_ROWS)):
            parts.append(json_arrays(path, block, specs, _places(block)))
        return {spec.name: np.concatenate([p[spec.name] for p in parts]) for spec in specs}

    def scene_tokens(self) -> dict[str, str]:
        """Return the token of each scene by name, in order; raise DataError for a name twice."""
        return scene_tokens(self.columns("scene", (TOKEN, ColumnSpec("name", str))))


def _place(name: str, token: Any) -> str:
    shown = token.decode(errors="replace") if isinstance(token, bytes) else token
    return f"{name} of record {shown}"


def _places(block: list[Row]) -> Callable[[str, int], str]:
    return lambda name, index: _place(name, block[index].get("token", "?"))


def text_of(values: NDArray[np.bytes_]) -> list[str]:
    """Return stored text as strings."""
    return [value.decode() for value in values.tolist()]


def scene_tokens(scenes: Columns) -> dict[str, str]:
    """Return the token of each scene by name, in order; raise DataError for a name twice."""
    scenes.refuse_repeated("name", scenes["name"], "each name once")
    return dict(zip(text_of(scenes["name"]), text_of(scenes["token"]), strict=True))


def looked_up(tokens: NDArray[np.bytes_], index: dict[str, int]) -> I64:
    """Return the index of each token, all of which are in `index`."""
    place = {name.encode(): k for name, k in index.items()}
    return np.array([place[token] for token in tokens.tolist()], dtype=np.int64)


def json_arrays(
    path: Path, rows: list[Row], specs: tuple[ColumnSpec, ...], place: Callable[[str, int], str]
) -> dict[str, NDArray[Any]]:
    """Return the fields of records as arrays, text as bytes.

    Args:
        path: the file.
        rows: the records.
        specs: the fields.
        place: what an error message calls a value, from the field's name and the record's index.

    Raises:
        DataError: a record lacks a field or holds a value of another kind.
    """
    arrays = {}
    for spec in specs:
        try:
            values = list(map(itemgetter(spec.name), rows))
        except KeyError:
            values = [row.get(spec.name) for row in rows]
        array = json_array(values, spec)
        if array is None:
            bad = next(i for i, value in enumerate(values) if json_array([value], spec) is None)
            shown = rows[bad].get(spec.name, "missing")
            raise DataError(path, place(spec.name, bad), shown, spec.expected)
        arrays[spec.name] = array
    return arrays


def _encoded_texts(values: list[Any]) -> NDArray[np.bytes_] | None:
    # half a surrogate pair is not printable, nor is a NUL, which numpy would drop from the end
    try:
        if not all(map(str.isprintable, values)):
            return None
    except TypeError:
        return None
    return np.array(list(map(str.encode, values)), np.bytes_)


def json_array(values: list[Any], spec: ColumnSpec) -> NDArray[Any] | None:
    """Return values of JSON as an array, or None if one of them is of another kind."""
    if spec.kind is str:
        return _encoded_texts(values)
    if not values:
        return spec.array([])
    shape = (len(values), spec.width) if spec.width else (len(values),)
    try:
        array = np.array(values)
    except (ValueError, OverflowError):
        return None
    if array.dtype == np.uint64 and spec.kind is int:
        return None  # beyond 63 bits: it would come out negative
    # true and false are taken for integers
    if array.shape != shape or array.dtype.kind not in ("iub" if spec.kind is int else "iuf"):
        return None
    if not np.isfinite(array).all():
        return None
    return array.astype(np.int64 if spec.kind is int else np.float64)


def table_path(dataroot: Path, version: str, name: str) -> Path:
    """Return the file of a table; raise DataError when the folder or the file is not there."""
    folder = inside(dataroot, version, follow_links=True)
    if not folder.is_dir():
        found = sorted(p.name for p in dataroot.glob("v*") if p.is_dir())
        expected = f"a folder of tables (here: {', '.join(found) or 'none'})"
        raise DataError(dataroot, "version", version, expected)
    path = folder / f"{name}.json"
    if not path.is_file():
        state = "not a file" if present(path) else "missing"
        raise DataError(path, "table", state, f"{name}.json in nuScenes format")
    return path
