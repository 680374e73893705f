"""Messages in a ROS 1 bag, an sqlite file of ROS 2, or a compressed bag folder of ROS 2."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Rosbag1Reader
from rosbags.rosbag2 import Reader as Rosbag2Reader

from mottrack.datasets.ros.log_file import CDR, ROS1, Definition, Record

ROS1_SUFFIX = ".bag"


class RosbagFile:
    """Reads messages with rosbags; the file stays open."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._encoding = ROS1 if path.suffix == ROS1_SUFFIX else CDR
        self._open: Any = None

    def topics(self) -> dict[str, Sequence[str]]:
        """Return the types of messages by topic."""
        found: dict[str, Sequence[str]] = {}
        for connection in self._reader.connections:
            kinds = (*found.get(connection.topic, ()), connection.msgtype)
            found[connection.topic] = tuple(dict.fromkeys(kinds))
        return found

    def records(self, topic: str, at_ns: int | None = None) -> Iterator[Record]:
        """Yield the messages of a topic in order of recording, or those recorded at one time."""
        reader = self._reader
        chosen = [c for c in reader.connections if c.topic == topic]
        if not chosen:
            return
        stop_ns = None if at_ns is None else at_ns + 1
        for connection, time_ns, data in reader.messages(chosen, start=at_ns, stop=stop_ns):
            yield Record(self._definition(connection), time_ns, bytes(data))

    def _definition(self, connection: Connection) -> Definition:
        how = connection.msgdef.format
        text = "" if how == MessageDefinitionFormat.NONE else connection.msgdef.data
        idl = how == MessageDefinitionFormat.IDL
        return Definition(connection.msgtype, text, idl, self._encoding)

    @property
    def _reader(self) -> Any:
        if self._open is None:
            kind = Rosbag1Reader if self._encoding == ROS1 else Rosbag2Reader
            opened = kind(self.path)
            opened.open()
            self._open = opened
        return self._open
