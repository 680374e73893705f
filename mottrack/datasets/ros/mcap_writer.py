"""A ROS 2 log written as one mcap file: `ros2 bag play`, rviz and Foxglove read it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from mottrack.core.storage import atomic_file
from mottrack.datasets.ros.message_types import type_store


class McapWriter:
    """Writes messages with the definitions of their types, which viewers need."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add(self, topic: str, stamp_ns: int, message: Any) -> None:
        """Add a message of rosbags, recorded at its own stamp in nanoseconds."""
        kind = message.__msgtype__
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schema(kind))
        data = bytes(type_store().serialize_cdr(message, kind))
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns)

    def _schema(self, kind: str) -> int:
        if kind not in self._schemas:
            text = type_store().generate_msgdef(kind, ros_version=2)[0]
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text.encode())
        return self._schemas[kind]


@contextmanager
def new_mcap(path: Path) -> Iterator[McapWriter]:
    """Open a log to be written; the file takes its name when all is written.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic_file(path) as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="mottrack")
        yield McapWriter(writer)
        writer.finish()  # type: ignore[no-untyped-call]
