"""Tables of a data set in nuScenes format, read in bounded memory.

A table is a JSON array of flat records (`sample.json`, `ego_pose.json`, ...). The large ones hold
millions of records of which a task needs few, so `stream_table` parses a block at a time and
`select_rows` keeps only what is asked for.
"""

import re
from collections.abc import Callable, Container, Iterator
from pathlib import Path
from typing import Any

import orjson

from mottrack.core.errors import DataError

Row = dict[str, Any]
Thinning = Callable[[bytes], bytes]
"""Takes the text of an array of records and returns one of fewer records."""
_BLOCK_BYTES = 2**20
_PATIENCE_BLOCKS = 4
"""Text that does not parse after so many more blocks is damaged, not cut in an unlucky place."""
_BETWEEN_RECORDS = re.compile(rb"\}\s*,\s*\{")


def table_path(dataroot: Path, version: str, name: str) -> Path:
    """The file of a table; raises DataError when the folder or the file is not there."""
    folder = dataroot / version
    if not folder.is_dir():
        found = sorted(p.name for p in dataroot.glob("v*") if p.is_dir())
        expected = f"a folder of tables (here: {', '.join(found) or 'none'})"
        raise DataError(dataroot, "version", version, expected)
    path = folder / f"{name}.json"
    if not path.is_file():
        raise DataError(path, "table", "missing", f"{name}.json in nuScenes format")
    return path


def read_table(dataroot: Path, version: str, name: str) -> list[Row]:
    """All records of a table, in the order of the file."""
    return list(stream_table(table_path(dataroot, version, name)))


def select_rows(
    dataroot: Path, version: str, name: str, keep: Callable[[Row], bool]
) -> Iterator[Row]:
    """The records of a table for which `keep` holds, in the order of the file."""
    return (row for row in stream_table(table_path(dataroot, version, name)) if keep(row))


def stream_table(
    path: Path, block_bytes: int = _BLOCK_BYTES, thin: Thinning | None = None
) -> Iterator[Row]:
    """Records of the JSON array in `path`, one block in memory at a time.

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
            elif len(rest) > _PATIENCE_BLOCKS * block_bytes:
                break
    yield from _parse(path, rest, done, thin)


def records_with(name: str, values: Container[bytes]) -> Thinning:
    """Drops records whose text field `name` has none of the values, without parsing them.

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
    """A field of a record; raises DataError that names the table when the record lacks it."""
    if name not in row:
        raise DataError(path, name, f"missing in record {row.get('token', '?')}", "this field")
    return row[name]


def _last_cut(text: bytes) -> int:
    """Where the last complete record of the text ends (just past its brace), 0 if none does."""
    at = len(text)
    while (at := text.rfind(b"}", 0, at)) > 0:
        if _BETWEEN_RECORDS.match(text, at):
            return at + 1
    return 0


def _opened(text: bytes, done: int) -> bytes:
    """A piece of the array, before which `done` bytes are read, as the beginning of an array."""
    return b"[" + text.lstrip().removeprefix(b",") if done else text


def _try_parse(text: bytes, thin: Thinning | None) -> list[Row] | None:
    """Records of an array, or None where the text is no whole number of records."""
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
