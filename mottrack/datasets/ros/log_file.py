"""One file of a log: what readers of every format give, and what they raise on damaged bytes."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import apsw
from mcap.exceptions import McapError
from rosbags.rosbag1 import ReaderError as Rosbag1Error
from rosbags.rosbag2 import ReaderError as Rosbag2Error
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError
from zstandard import ZstdError

from mottrack.core.errors import DataError, InputError
from mottrack.core.sweep import SECOND_NS
from mottrack.datasets.ros.message_types import store_of, type_store

ROS1, CDR = "ros1", "cdr"
"""How messages are written: as ROS 1 does, and as ROS 2."""
_CDR_STAMPS = {0: struct.Struct(">iI"), 1: struct.Struct("<iI")}
"""builtin_interfaces/msg/Time, seconds and nanoseconds, by the endianness of the message."""
_CDR_HEADER_BYTES = 4  # encapsulation kind and options before every CDR message
_ROS1_STAMP = struct.Struct("<III")
"""The header of ROS 1: a number, seconds, nanoseconds."""
# mcap and rosbags check little themselves: this is what they raise on damaged bytes
_FAULTS = (
    McapError,
    SerdeError,
    TypesysError,
    Rosbag1Error,
    Rosbag2Error,
    ZstdError,
    apsw.Error,
    OSError,
    EOFError,
    struct.error,
    ValueError,
    LookupError,
    RuntimeError,
    AssertionError,
    AttributeError,
    TypeError,
    OverflowError,
    MemoryError,
)


class Definition(NamedTuple):
    """A type of messages as a log defines it.

    kind: `package/msg/Name`.
    text: its definition; empty where the log has none.
    idl: whether that is written in IDL.
    encoding: `ROS1` or `CDR`.
    """

    kind: str
    text: str
    idl: bool
    encoding: str


class Record(NamedTuple):
    """A message as it is stored."""

    definition: Definition
    log_time_ns: int
    data: bytes

    @property
    def stamp_ns(self) -> int:
        """The stamp in the header that the message begins with; nothing else is read."""
        if self.definition.encoding == ROS1:
            _, seconds, nanoseconds = _ROS1_STAMP.unpack_from(self.data)
        else:
            stamp = _CDR_STAMPS[self.data[1]]
            seconds, nanoseconds = stamp.unpack_from(self.data, _CDR_HEADER_BYTES)
        return int(seconds) * SECOND_NS + int(nanoseconds)


class LogFile(Protocol):
    """A file, or a folder of files, that holds messages."""

    @property
    def path(self) -> Path:
        """What errors name."""
        ...

    def topics(self) -> dict[str, Sequence[str]]:
        """Return the types of messages by topic: one, but for damaged or strange logs."""
        ...

    def records(self, topic: str, at_ns: int | None = None) -> Iterator[Record]:
        """Yield the messages of a topic in order of recording, or those recorded at one time."""
        ...


class Decoder:
    """Makes messages of records, each by the definition that the log holds, if it holds one."""

    def __init__(self) -> None:
        self._stores: dict[Definition, Any] = {}

    def message(self, record: Record) -> Any:
        """Return the message of a record."""
        definition = record.definition
        if definition not in self._stores:
            self._stores[definition] = (
                store_of(definition.kind, definition.text, idl=definition.idl)
                if definition.text
                else type_store()
            )
        store = self._stores[definition]
        if definition.encoding == ROS1:
            return store.deserialize_ros1(record.data, definition.kind)
        return store.deserialize_cdr(record.data, definition.kind)


@contextmanager
def faults(path: Path) -> Iterator[None]:
    """Turn what a reader raises on a damaged file into a `DataError` that names it."""
    try:
        yield
    except InputError as error:
        raise DataError(path, error.field, error.value, error.expected) from error
    except DataError:
        raise
    except _FAULTS as error:
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
        raise DataError(path, "content", f"unreadable ({reason})", "a log of ROS") from error
