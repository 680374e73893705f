"""Messages of a ROS 2 log (mcap) by topic."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from mcap.exceptions import McapError
from mcap.reader import McapReader, make_reader
from mcap.records import Message
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from zstandard import ZstdError

from mottrack.core.errors import DataError, InputError
from mottrack.core.limits import MAX_RECORD_BYTES
from mottrack.core.sweep import SECOND_NS
from mottrack.formats.faults import TruncatedError

_STAMP = struct.Struct("<iI")
"""builtin_interfaces/msg/Time, little-endian: seconds, nanoseconds."""
_CDR_HEADER_BYTES = 4  # encapsulation kind and options before every CDR message
_MAGIC = b"\x89MCAP0\r\n"
"""The first and the last bytes of a log."""
# mcap and rosbags check little themselves: this is what they raise on damaged bytes
_FAULTS = (
    McapError,
    SerdeError,
    ZstdError,
    OSError,
    struct.error,
    ValueError,
    LookupError,
    RuntimeError,
    AssertionError,
    TypeError,
    OverflowError,
    MemoryError,
)


@dataclass(frozen=True)
class MessageTime:
    """The two times of a message: when it was recorded, and the stamp in its header."""

    log_time_ns: int
    stamp_ns: int


class McapFile:
    """Reads ROS 2 messages; every fault of the file is a DataError."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._types = get_typestore(Stores.ROS2_HUMBLE)
        self._looked_at = False

    def times(self, topic: str, kinds: tuple[str, ...]) -> list[MessageTime]:
        """Return the times of the messages of a topic, in order of recording.

        Raises:
            DataError: the file is damaged, or has no such topic with one of these types.
        """
        with self._faults():
            found = [
                MessageTime(m.log_time, header_stamp(m.data)) for _, m in self._typed(topic, kinds)
            ]
        self._require(topic, found)
        return found

    def message(self, topic: str, time: MessageTime) -> Any:
        """Return the message of a topic with these times.

        Raises:
            DataError: the file is damaged, or has no such message.
        """
        with self._faults():
            for kind, message in self._raw(topic, time.log_time_ns):
                if header_stamp(message.data) == time.stamp_ns:
                    return self._types.deserialize_cdr(message.data, kind)
        raise DataError(self._path, "message", "missing", f"{topic} at {time.log_time_ns}")

    def messages(self, topic: str, kinds: tuple[str, ...]) -> list[Any]:
        """Return all messages of a topic, in order of recording.

        Raises:
            DataError: the file is damaged, or has no such topic with one of these types.
        """
        with self._faults():
            found = [
                self._types.deserialize_cdr(m.data, kind) for kind, m in self._typed(topic, kinds)
            ]
        self._require(topic, found)
        return found

    def _require(self, topic: str, found: Sequence[object]) -> None:
        if not found:
            raise DataError(self._path, "topic", f"no message on {topic}", self._topics())

    def _typed(self, topic: str, kinds: tuple[str, ...]) -> Iterator[tuple[str, Message]]:
        """Yield what `_raw` does; refuse a topic of another type, as when two are mixed up."""
        for kind, message in self._raw(topic):
            if kind not in kinds:
                raise DataError(self._path, f"type of {topic}", kind, " or ".join(kinds))
            yield kind, message

    def _raw(self, topic: str, at_ns: int | None = None) -> Iterator[tuple[str, Message]]:
        """Yield the type and the message of each record of a topic, as it is stored."""
        with self._path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            if not self._looked_at:
                self._require_finished(file)
                self._require_small_blocks(reader)
                self._looked_at = True
            chosen = reader.iter_messages(topics=[topic], starting_at=at_ns, ending_at=at_ns)
            for schema, _, message in chosen:
                yield "" if schema is None else schema.name, message

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
            raise TruncatedError(self._path, "end of file", "unfinished", expected)

    def _require_small_blocks(self, reader: McapReader) -> None:
        summary = reader.get_summary()
        indexes = summary.chunk_indexes if summary else ()
        largest = max((index.uncompressed_size for index in indexes), default=0)
        if largest > MAX_RECORD_BYTES.value:
            expected = MAX_RECORD_BYTES.expected("bytes")
            raise DataError(self._path, "size of a block", largest, expected)

    def _topics(self) -> str:
        with self._faults(), self._path.open("rb") as file:
            summary = make_reader(file).get_summary()
        channels = summary.channels.values() if summary else ()
        return "one of " + (", ".join(sorted(c.topic for c in channels)) or "no topic at all")

    @contextmanager
    def _faults(self) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            raise DataError(self._path, error.field, error.value, error.expected) from error
        except DataError:
            raise
        except _FAULTS as error:
            reason = f"{type(error).__name__}: {error}".splitlines()[0]
            raise DataError(self._path, "content", f"unreadable ({reason})", "mcap") from error


def header_stamp(data: bytes) -> int:
    """Return the stamp, in ns, that begins a message with a header; nothing else is read."""
    seconds, nanoseconds = _STAMP.unpack_from(data, _CDR_HEADER_BYTES)
    return int(seconds) * SECOND_NS + int(nanoseconds)
