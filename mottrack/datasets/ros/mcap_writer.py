"""A ROS 2 log written as one mcap file: `ros2 bag play`, rviz and Foxglove read it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from mottrack.core.storage import write_bytes
from mottrack.datasets.ros.message_types import type_store


class McapWriter:
    """Collects messages in memory, compressed block by block, and writes the file at the end."""

    def __init__(self) -> None:
        self._buffer = io.BytesIO()
        self._writer = Writer(self._buffer)
        self._writer.start(profile="ros2", library="mottrack")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add(self, topic: str, stamp_ns: int, message: Any) -> None:
        """Add a message of rosbags, recorded at its own stamp in nanoseconds."""
        kind = message.__msgtype__
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schema(kind))
        data = bytes(type_store().serialize_cdr(message, kind))
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns)

    def save(self, path: Path) -> None:
        """Finish the log and write it atomically; nothing can be added afterwards."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        write_bytes(path, self._buffer.getvalue())

    def _schema(self, kind: str) -> int:
        if kind not in self._schemas:
            text = type_store().generate_msgdef(kind, ros_version=2)[0]
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text.encode())
        return self._schemas[kind]
