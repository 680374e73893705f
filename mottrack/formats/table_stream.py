"""Arrays of records in JSON, a block at a time, in bounded memory.

Tables of whole data sets hold millions of records, of which a task needs few: most of the others
are dropped before they are parsed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import orjson

from mottrack.core.errors import DataError

Row = dict[str, Any]
_BLOCK_BYTES = 2**20
"""Text parsed at a time: large enough that orjson's speed counts, small beside other memory."""
_MAX_UNPARSED_BLOCKS = 4
"""Text that does not parse after so many more blocks is damaged, not cut inside a record."""
_BETWEEN_RECORDS = re.compile(rb"\}\s*,\s*\{")


class Thinned(NamedTuple):
    """The text of an array of records, and how many were taken out of it."""

    text: bytes
    dropped: int
    exact: bool = False
    """Whether every record that is left has one of the wanted values."""


class Block(NamedTuple):
    """Records of a piece of a table."""

    rows: list[Row]
    exact: bool


Thinning = Callable[[bytes], Thinned]


@dataclass
class RecordCount:
    """How many records a table held, the unwanted ones included."""

    records: int = 0


@dataclass(frozen=True)
class RecordFilter:
    """Which records of a table are wanted: each named field has a value in its set.

    The first field is searched before parsing, which saves most, so it should be the one that
    excludes most records.

    wanted: values by field.
    known: all values that a field may have at all; a record with another one points nowhere.
    count: counts every record of the table, wanted or not.
    """

    wanted: Mapping[str, Collection[str]] = field(default_factory=dict)
    known: Mapping[str, Collection[str]] = field(default_factory=dict)
    count: RecordCount = field(default_factory=RecordCount)

    @property
    def needs_each_record(self) -> bool:
        """Whether what is wanted cannot be told from the first field's text alone."""
        return len({*self.wanted, *self.known}) > len(self.wanted) or len(self.wanted) > 1

    def thinning(self) -> Thinning:
        """Return a function that drops most of the others before they are parsed."""
        if not self.wanted:
            return whole
        name, values = next(iter(self.wanted.items()))
        known = self.known.get(name)
        return records_with(name, encoded(values), None if known is None else encoded(known))

    def holds(self, path: Path, row: Row) -> bool:
        """Return whether the record is one of them.

        Raises:
            DataError: a field has a value that it can't have.
        """
        for name, values in self.known.items():
            value = row.get(name)
            if type(value) is not str or value not in values:
                place = f"{name} of record {row.get('token', '?')}"
                raise DataError(path, place, row.get(name, "missing"), "the token of a record")
        for name, values in self.wanted.items():
            value = row.get(name)
            if type(value) is not str or value not in values:
                return False
        return True


EVERY_RECORD = RecordFilter()


def encoded(values: Collection[str]) -> frozenset[bytes]:
    """Return texts as they stand in a file."""
    return frozenset(value.encode() for value in values)


def wanted_records(path: Path, among: RecordFilter) -> Iterator[Row]:
    """Yield the wanted records of a table in the order of the file."""
    further = among.needs_each_record
    for block in _blocks(path, _BLOCK_BYTES, among.thinning(), among.count):
        if further or not block.exact:
            yield from filter(partial(among.holds, path), block.rows)
        else:
            yield from block.rows


def whole(text: bytes) -> Thinned:
    """Drop nothing; nothing is known of the records."""
    return Thinned(text, 0)


def stream_table(
    path: Path,
    block_bytes: int = _BLOCK_BYTES,
    thin: Thinning = whole,
    count: RecordCount | None = None,
) -> Iterator[Row]:
    """Yield the records of the JSON array in `path`, one block in memory at a time.

    Blocks are cut between records. A text value that holds "},{" can put the cut inside a record;
    such a piece does not parse and is joined to the next one. `thin` may drop records from the
    text before it is parsed, which is what costs the time. Raises DataError for anything that is
    not an array of records.
    """
    for block in _blocks(path, block_bytes, thin, count or RecordCount()):
        yield from block.rows


def array_blocks(path: Path, block_bytes: int) -> Iterator[bytes]:
    """Yield an array of records in pieces that are arrays themselves, cut between records.

    A text value that holds "},{" can put the cut inside a record: such a piece does not parse.
    """
    done, rest = 0, b""
    with opened(path) as file:
        while block := file.read(block_bytes):
            rest += block
            if cut := _last_cut(rest):
                yield _opened(rest[:cut], done) + b"]"
                done += cut
                rest = rest[cut:]
    yield _opened(rest, done)


def _blocks(path: Path, block_bytes: int, thin: Thinning, count: RecordCount) -> Iterator[Block]:
    done = 0
    rest = b""
    with opened(path) as file:
        while block := file.read(block_bytes):
            rest += block
            cut = _last_cut(rest)
            found = _try_parse(_opened(rest[:cut], done) + b"]", thin, count) if cut else None
            if found is not None:
                yield found
                done += cut
                rest = rest[cut:]
            elif len(rest) > _MAX_UNPARSED_BLOCKS * block_bytes:
                break
    yield _parse(path, _Rest(rest, done), thin, count)


def records_with(
    name: str, values: frozenset[bytes], known: frozenset[bytes] | None = None
) -> Thinning:
    """Return what drops records whose text field `name` has none of the values, unparsed.

    Records hold no objects of their own, so each ends at a brace, and the n-th value of the field
    belongs to the n-th record. Where the counts differ (a brace in a text, a record without the
    field), or where a value is not `known`, nothing is dropped.
    """
    find = re.compile(rb'"' + name.encode() + rb'"\s*:\s*"([^"]*)"').findall

    def thin(text: bytes) -> Thinned:
        found = find(text)
        counted = len(found) == text.count(b"}") and found
        if not counted or not (known is None or known.issuperset(found)):
            return whole(text)
        if values.issuperset(found):
            return Thinned(text, 0, exact=True)
        *pieces, tail = text.split(b"}")
        kept = [p.lstrip(b"[, \r\n\t") for p, v in zip(pieces, found, strict=True) if v in values]
        thinned = b"[" + b"},".join(kept) + (b"}" if kept else b"") + tail
        return Thinned(thinned, len(pieces) - len(kept), exact=True)

    return thin


class _Rest(NamedTuple):
    """The end of an array, which begins after `done` bytes of the file."""

    text: bytes
    done: int


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open a file to be read in blocks; raise DataError where the system refuses."""
    try:
        file = path.open("rb")
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise DataError(path, "file", f"unreadable ({reason})", "a readable file") from error
    with file:
        yield file


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


def _try_parse(text: bytes, thin: Thinning, count: RecordCount) -> Block | None:
    """Return the records of an array, or None where the text does not end between records."""
    thinned = thin(text)
    try:
        rows = orjson.loads(thinned.text)
    except orjson.JSONDecodeError:
        return None
    if not _is_table(rows):
        return None
    count.records += thinned.dropped + len(rows)
    return Block(rows, thinned.exact)


def _parse(path: Path, rest: _Rest, thin: Thinning, count: RecordCount) -> Block:
    text = _opened(rest.text, rest.done)
    found = _try_parse(text, thin, count)
    if found is not None:
        return found
    try:
        orjson.loads(text)
    except orjson.JSONDecodeError as error:
        where = f"unreadable ({error.msg} near byte {rest.done + error.pos})"
        raise DataError(path, "JSON", where, "an array of records") from error
    except MemoryError as error:
        raise DataError(path, "JSON", "too large for the memory", "an array of records") from error
    raise DataError(path, "table", "another JSON value", "an array of records")


def _is_table(rows: object) -> bool:
    return isinstance(rows, list) and all(isinstance(row, dict) for row in rows)
