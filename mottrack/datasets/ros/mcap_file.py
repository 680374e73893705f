"""Messages in an mcap file."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

from mcap.reader import McapReader, make_reader
from mcap.records import Channel, Schema

from mottrack.core.errors import DataError
from mottrack.core.limits import MAX_RECORD_BYTES
from mottrack.datasets.ros.log_file import CDR, ROS1, Definition, Record
from mottrack.formats.faults import TruncatedError

_MAGIC = b"\x89MCAP0\r\n"
"""The first and the last bytes of a log."""


class McapFile:
    """Reads the messages of one mcap file, checksums included."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._looked_at = False

    def topics(self) -> dict[str, Sequence[str]]:
        """Return the types of messages by topic."""
        with self.path.open("rb") as file:
            summary = self._reader(file).get_summary()
        found: dict[str, Sequence[str]] = {}
        for channel in summary.channels.values() if summary else ():
            schema = summary.schemas.get(channel.schema_id) if summary else None
            kinds = (*found.get(channel.topic, ()), _definition(schema, channel).kind)
            found[channel.topic] = tuple(dict.fromkeys(kinds))
        return found

    def records(self, topic: str, at_ns: int | None = None) -> Iterator[Record]:
        """Yield the messages of a topic in order of recording, or those recorded at one time."""
        with self.path.open("rb") as file:
            reader = self._reader(file)
            chosen = reader.iter_messages([topic], starting_at=at_ns, ending_at=at_ns)
            for schema, channel, message in chosen:
                yield Record(_definition(schema, channel), message.log_time, message.data)

    def _reader(self, file: BinaryIO) -> McapReader:
        reader = make_reader(file, validate_crcs=True)
        if not self._looked_at:
            self._require_finished(file)
            self._require_small_blocks(reader)
            self._looked_at = True
        return reader

    def _require_finished(self, file: BinaryIO) -> None:
        """Refuse a log whose recorder was killed: without the end there is no index."""
        before = file.tell()  # the reader may have read the start by now
        file.seek(0)
        start = file.read(len(_MAGIC))
        file.seek(-min(len(_MAGIC), file.seek(0, os.SEEK_END)), os.SEEK_END)
        end = file.read()
        file.seek(before)
        if start == _MAGIC and end != _MAGIC:
            expected = "a finished log (`mcap recover` mends one)"
            raise TruncatedError(self.path, "end of file", "unfinished", expected)

    def _require_small_blocks(self, reader: McapReader) -> None:
        summary = reader.get_summary()
        indexes = summary.chunk_indexes if summary else ()
        largest = max((index.uncompressed_size for index in indexes), default=0)
        if largest > MAX_RECORD_BYTES.value:
            expected = MAX_RECORD_BYTES.expected("bytes")
            raise DataError(self.path, "size of a block", largest, expected)


def _definition(schema: Schema | None, channel: Channel) -> Definition:
    if schema is None:
        return Definition("", "", False, CDR)
    encoding = ROS1 if channel.message_encoding == ROS1 else CDR
    package, _, name = schema.name.rpartition("/")
    kind = f"{package.removesuffix('/msg')}/msg/{name}"  # ROS 1 leaves the msg out
    text = schema.data.decode() if schema.encoding in ("ros1msg", "ros2msg", "ros2idl") else ""
    return Definition(kind, text, schema.encoding == "ros2idl", encoding)
