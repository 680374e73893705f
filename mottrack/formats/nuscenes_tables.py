"""Tables of a data set in nuScenes format, read in bounded memory.

A table is a JSON array of flat records (`sample.json`, `ego_pose.json`, ...). The large ones hold
millions of records of which a task needs few, so they are parsed a block at a time and only the
records that are asked for are kept, as dictionaries or as checked columns.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Container, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from mottrack.core.arrays import I64
from mottrack.core.errors import DataError
from mottrack.formats.columns import Columns, ColumnSpec

Row = dict[str, Any]
Thinning = Callable[[bytes], bytes]
"""Takes the text of an array of records and returns one of fewer records."""
_BLOCK_BYTES = 2**20
"""Text parsed at a time: large enough that orjson's speed counts, small beside other memory."""
_MAX_UNPARSED_BLOCKS = 4
"""Text that does not parse after so many more blocks is damaged, not cut inside a record."""
_BLOCK_ROWS = 20_000
"""Records held as dictionaries before they become arrays: about 20 MB."""
_BETWEEN_RECORDS = re.compile(rb"\}\s*,\s*\{")

TOKEN = ColumnSpec("token", str)
# quaternions w, x, y, z and positions x, y, z
ROTATION = ColumnSpec("rotation", width=4)
TRANSLATION = ColumnSpec("translation", width=3)


@dataclass(frozen=True)
class RecordFilter:
    """Which records of a table are wanted: each named field has a value in its set.

    The first field is searched before parsing, which saves most, so it should be the one that
    excludes most records.
    """

    wanted: Mapping[str, Collection[str]]

    def thinning(self) -> Thinning:
        """Return a function that drops most of the others before they are parsed."""
        name, values = next(iter(self.wanted.items()))
        return records_with(name, frozenset(value.encode() for value in values))

    def holds(self, row: Row) -> bool:
        """Return whether the record is one of them; one without the field is not."""
        for name, values in self.wanted.items():
            value = row.get(name)
            if not isinstance(value, str) or value not in values:
                return False
        return True


@dataclass(frozen=True)
class NuScenesTables:
    """The folder of tables of one version."""

    root: Path
    version: str

    def path(self, name: str) -> Path:
        """Return the file of a table; raise DataError when it is missing."""
        return table_path(self.root, self.version, name)

    def rows(self, name: str, among: RecordFilter | None = None) -> Iterator[Row]:
        """Yield the wanted records of a table, all of them by default, in the order of the file."""
        if among is None:
            return stream_table(self.path(name))
        return filter(among.holds, stream_table(self.path(name), thin=among.thinning()))

    def columns(
        self, name: str, specs: tuple[ColumnSpec, ...], among: RecordFilter | None = None
    ) -> Columns:
        """Return the wanted records as arrays, text as bytes, which take a quarter of the memory.

        Raises:
            DataError: a record lacks a field or holds a value of another kind.
        """
        path = self.path(name)
        rows = self.rows(name, among)
        parts = [json_arrays(path, [], specs, _place)]
        while block := list(islice(rows, _BLOCK_ROWS)):
            parts.append(json_arrays(path, block, specs, _places(block)))
        arrays = {spec.name: np.concatenate([p[spec.name] for p in parts]) for spec in specs}
        count = len(arrays[specs[0].name])
        return Columns(path, arrays, arrays.get("token", np.arange(count)), _place)

    def scene_tokens(self) -> dict[str, str]:
        """Return the token of each scene by name, in order; raise DataError for a name twice."""
        scenes = self.columns("scene", (TOKEN, ColumnSpec("name", str)))
        scenes.refuse_repeated("name", scenes["name"], "each name once")
        return dict(zip(text_of(scenes["name"]), text_of(scenes["token"]), strict=True))


def _place(name: str, token: Any) -> str:
    shown = token.decode(errors="replace") if isinstance(token, bytes) else token
    return f"{name} of record {shown}"


def _places(block: list[Row]) -> Callable[[str, int], str]:
    return lambda name, index: _place(name, block[index].get("token", "?"))


def text_of(values: NDArray[np.bytes_]) -> list[str]:
    """Return stored text as strings."""
    return [value.decode() for value in values.tolist()]


def looked_up(tokens: NDArray[np.bytes_], index: dict[str, int]) -> I64:
    """Return the index of each token, all of which are in `index`."""
    return np.array([index[token] for token in text_of(tokens)], dtype=np.int64)


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
        values = [row.get(spec.name) for row in rows]
        array = json_array(values, spec)
        if array is None:
            bad = next(i for i, value in enumerate(values) if json_array([value], spec) is None)
            shown = rows[bad].get(spec.name, "missing")
            raise DataError(path, place(spec.name, bad), shown, spec.expected)
        arrays[spec.name] = array
    return arrays


def json_array(values: list[Any], spec: ColumnSpec) -> NDArray[Any] | None:
    """Return values of JSON as an array, or None if one of them is of another kind."""
    if spec.kind is str:
        if not all(isinstance(value, str) for value in values):
            return None
        return np.array([value.encode() for value in values], dtype=np.bytes_)
    if not values:
        return spec.array([])
    shape = (len(values), spec.width) if spec.width else (len(values),)
    try:
        array = np.array(values)
    except ValueError:
        return None
    # true and false are taken for integers
    if array.shape != shape or array.dtype.kind not in ("iub" if spec.kind is int else "iuf"):
        return None
    if not np.isfinite(array).all():
        return None
    return array.astype(np.int64 if spec.kind is int else np.float64)


def table_path(dataroot: Path, version: str, name: str) -> Path:
    """Return the file of a table; raise DataError when the folder or the file is not there."""
    folder = dataroot / version
    if not folder.is_dir():
        found = sorted(p.name for p in dataroot.glob("v*") if p.is_dir())
        expected = f"a folder of tables (here: {', '.join(found) or 'none'})"
        raise DataError(dataroot, "version", version, expected)
    path = folder / f"{name}.json"
    if not path.is_file():
        raise DataError(path, "table", "missing", f"{name}.json in nuScenes format")
    return path


def stream_table(
    path: Path, block_bytes: int = _BLOCK_BYTES, thin: Thinning | None = None
) -> Iterator[Row]:
    """Yield the records of the JSON array in `path`, one block in memory at a time.

    Blocks are cut between records. A text value that holds "},{" can put the cut inside a record;
    such a piece does not parse and is joined to the next one. `thin` may drop records from the
    text before it is parsed, which is what costs the time. Raises DataError for anything that is
    not an array of records.
    """
    done = 0
    rest = b""
    with path.open("rb") as file:
        while block := file.read(block_bytes):
            rest += block
            cut = _last_cut(rest)
            rows = _try_parse(_opened(rest[:cut], done) + b"]", thin) if cut else None
            if rows is not None:
                yield from rows
                done += cut
                rest = rest[cut:]
            elif len(rest) > _MAX_UNPARSED_BLOCKS * block_bytes:
                break
    yield from _parse(path, rest, done, thin)


def records_with(name: str, values: Container[bytes]) -> Thinning:
    """Return what drops records whose text field `name` has none of the values, unparsed.

    Records hold no objects of their own, so each ends at a brace, and the n-th value of the field
    belongs to the n-th record. Where the counts differ (a brace in a text, a record without the
    field) nothing is dropped.
    """
    find = re.compile(rb'"' + name.encode() + rb'"\s*:\s*"([^"]*)"').findall

    def thin(text: bytes) -> bytes:
        *pieces, tail = text.split(b"}")
        found = find(text)
        if len(found) != len(pieces):
            return text
        kept = [p.lstrip(b"[, \r\n\t") for p, v in zip(pieces, found, strict=True) if v in values]
        return b"[" + b"},".join(kept) + (b"}" if kept else b"") + tail

    return thin


def field(row: Row, name: str, path: Path) -> Any:
    """Return a field of a record; raise DataError that names the table where it is missing."""
    if name not in row:
        raise DataError(path, name, f"missing in record {row.get('token', '?')}", "this field")
    return row[name]


def _last_cut(text: bytes) -> int:
    """Return where the last complete record ends (just past its brace), 0 if none does."""
    at = len(text)
    while (at := text.rfind(b"}", 0, at)) > 0:
        if _BETWEEN_RECORDS.match(text, at):
            return at + 1
    return 0


def _opened(text: bytes, done: int) -> bytes:
    """Return a piece of the array, which begins after `done` bytes, as the start of an array."""
    return b"[" + text.lstrip().removeprefix(b",") if done else text


def _try_parse(text: bytes, thin: Thinning | None) -> list[Row] | None:
    """Return the records of an array, or None where the text does not end between records."""
    try:
        rows = orjson.loads(thin(text) if thin else text)
    except orjson.JSONDecodeError:
        return None
    return rows if _is_table(rows) else None


def _parse(path: Path, rest: bytes, done: int, thin: Thinning | None) -> list[Row]:
    text = _opened(rest, done)
    rows = _try_parse(text, thin)
    if rows is not None:
        return rows
    try:
        orjson.loads(text)
    except orjson.JSONDecodeError as error:
        where = f"{error.msg} near byte {done + error.pos}"
        raise DataError(path, "JSON", where, "an array of records") from error
    raise DataError(path, "table", "another JSON value", "an array of records")


def _is_table(rows: object) -> bool:
    return isinstance(rows, list) and all(isinstance(row, dict) for row in rows)
