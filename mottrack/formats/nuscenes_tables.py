"""Tables of a data set in nuScenes format, read in bounded memory.

A table is a JSON array of flat records (`sample.json`, `ego_pose.json`, ...). The large ones hold
millions of records of which a task needs few, so `stream_table` parses a block at a time and
`select_rows` keeps only what is asked for.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import orjson

from mottrack.core.errors import DataError

Row = dict[str, Any]
_BLOCK_BYTES = 16 * 2**20
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


def stream_table(path: Path, block_bytes: int = _BLOCK_BYTES) -> Iterator[Row]:
    """Records of the JSON array in `path`, one block in memory at a time.

    Blocks are cut between records. A text value that holds "},{" can put the cut inside a record;
    such a piece does not parse and is joined to the next one. Raises DataError for anything that
    is not an array of records.
    """
    done = 0
    rest = b""
    with path.open("rb") as file:
        while block := file.read(block_bytes):
            rest += block
            cut = _last_cut(rest)
            rows = _try_parse(rest[:cut], done == 0, closed=False) if cut else None
            if rows is not None:
                yield from rows
                done += len(rows)
                rest = rest[cut:]
    yield from _parse(path, rest, done)


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


def _try_parse(text: bytes, first: bool, *, closed: bool) -> list[Row] | None:
    """Records of a piece of the array, or None where the piece is no whole number of records."""
    body = text if first else b"[" + text.lstrip().removeprefix(b",")
    try:
        rows = orjson.loads(body if closed else body + b"]")
    except orjson.JSONDecodeError:
        return None
    return rows if _is_table(rows) else None


def _parse(path: Path, text: bytes, done: int) -> list[Row]:
    rows = _try_parse(text, done == 0, closed=True)
    if rows is not None:
        return rows
    try:
        orjson.loads(path.read_bytes())
    except orjson.JSONDecodeError as error:
        raise DataError(path, "JSON", str(error), "an array of records") from error
    raise DataError(path, "table", "another JSON value", "an array of records")


def _is_table(rows: object) -> bool:
    return isinstance(rows, list) and all(isinstance(row, dict) for row in rows)
