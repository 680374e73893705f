"""Messages of an mcap file by topic."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.reader import make_reader
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from zstandard import ZstdError

from mottrack.core.errors import DataError

_STAMP = struct.Struct("<iI")
_CDR_HEADER_BYTES = 4
# what the libraries raise on damaged bytes: they check little themselves
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
class Place:
    """Where a message is: its log time, and the stamp in its header."""

    log_time_ns: int
    stamp_ns: int


class McapFile:
    """Reads ROS 2 messages; every fault of the file is a DataError."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._types = get_typestore(Stores.ROS2_HUMBLE)

    def places(self, topic: str) -> list[Place]:
        """Return where the messages of a topic are, in order of log time.

        Raises:
            DataError: the file is damaged, or has no such topic.

        """
        with self._faults():
            found = [Place(log, _header_stamp(data)) for log, _, data in self._raw(topic)]
        self._require(topic, found)
        return found

    def message(self, topic: str, place: Place) -> Any:
        """Return the message at a place.

        Raises:
            DataError: the file is damaged, or has no message there.

        """
        with self._faults():
            for _, kind, data in self._raw(topic, place.log_time_ns):
                if _header_stamp(data) == place.stamp_ns:
                    return self._types.deserialize_cdr(data, kind)
        raise DataError(self._path, "message", "missing", f"{topic} at {place.log_time_ns}")

    def messages(self, topic: str) -> list[Any]:
        """Return all messages of a topic, in order of log time.

        Raises:
            DataError: the file is damaged, or has no such topic.

        """
        with self._faults():
            found = [self._types.deserialize_cdr(data, kind) for _, kind, data in self._raw(topic)]
        self._require(topic, found)
        return found

    def _require(self, topic: str, found: Sequence[object]) -> None:
        if not found:
            raise DataError(self._path, "topic", f"no message on {topic}", self._topics())

    def _raw(self, topic: str, at_ns: int | None = None) -> Iterator[tuple[int, str, bytes]]:
        with self._path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            chosen = reader.iter_messages(topics=[topic], starting_at=at_ns, ending_at=at_ns)
            for schema, _, message in chosen:
                kind = "" if schema is None else schema.name
                yield message.log_time, kind, message.data

    def _topics(self) -> str:
        with self._faults(), self._path.open("rb") as file:
            summary = make_reader(file).get_summary()
        channels = summary.channels.values() if summary else ()
        return "one of " + (", ".join(sorted(c.topic for c in channels)) or "no topic at all")

    @contextmanager
    def _faults(self) -> Iterator[None]:
        try:
            yield
        except _FAULTS as error:
            reason = f"{type(error).__name__}: {error}".splitlines()[0]
            raise DataError(self._path, "content", f"unreadable ({reason})", "mcap") from error


def _header_stamp(data: bytes) -> int:
    """The stamp that begins a message with a header, without reading the rest of it."""
    seconds, nanoseconds = _STAMP.unpack_from(data, _CDR_HEADER_BYTES)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)
