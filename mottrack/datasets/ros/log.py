"""A log of ROS by topic, whatever files it consists of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from mottrack.core.errors import DataError
from mottrack.datasets.ros.log_file import Decoder, LogFile, Record, faults
from mottrack.datasets.ros.mcap_file import McapFile
from mottrack.datasets.ros.rosbag_file import RosbagFile
from mottrack.formats.faults import MissingError
from mottrack.formats.files import inside
from mottrack.formats.yaml_file import read_yaml

METADATA = "metadata.yaml"
"""What makes a folder one recording of ROS 2."""
MCAP = ".mcap"
SUFFIXES = (MCAP, ".bag", ".db3")
"""Files that are a log each: ROS 2 or 1 as mcap, ROS 1, ROS 2 before mcap."""


class MessageTime(NamedTuple):
    """A message by its times and its place.

    log_time_ns: when it was recorded.
    stamp_ns: in its header.
    part: number of the file of the log.
    """

    log_time_ns: int
    stamp_ns: int
    part: int = 0


class Log:
    """Reads the messages of a log; every fault of a file is a DataError that names it."""

    def __init__(self, path: Path, parts: Sequence[LogFile]) -> None:
        self.path, self._parts = path, parts
        self._decoder = Decoder()

    @cached_property
    def topics(self) -> dict[str, tuple[str, ...]]:
        """The types of messages by topic.

        Raises:
            DataError: a file is damaged.
        """
        found: dict[str, tuple[str, ...]] = {}
        for part in self._parts:
            with faults(part.path):
                for topic, kinds in part.topics().items():
                    found[topic] = tuple(dict.fromkeys((*found.get(topic, ()), *kinds)))
        return found

    def times(self, topic: str, kinds: Sequence[str]) -> list[MessageTime]:
        """Return the times of the messages of a topic, in order of recording.

        Raises:
            DataError: a file is damaged, or there is no such topic with one of these types.
        """
        found = [
            MessageTime(record.log_time_ns, record.stamp_ns, number)
            for number, record in self._typed(topic, kinds)
        ]
        self._require(topic, found)
        return found

    def message(self, topic: str, time: MessageTime) -> Any:
        """Return the message of a topic with these times.

        Raises:
            DataError: the file is damaged, or has no such message.
        """
        part = self._parts[time.part]
        with faults(part.path):
            for record in part.records(topic, time.log_time_ns):
                if record.stamp_ns == time.stamp_ns:
                    return self._decoder.message(record)
        raise DataError(part.path, "message", "missing", f"{topic} at {time.log_time_ns}")

    def messages(self, topic: str, kinds: Sequence[str]) -> list[Any]:
        """Return all messages of a topic, in order of recording.

        Raises:
            DataError: a file is damaged, or there is no such topic with one of these types.
        """
        found = []
        for number, record in self._typed(topic, kinds):
            with faults(self._parts[number].path):
                found.append(self._decoder.message(record))
        self._require(topic, found)
        return found

    def of_kind(self, kinds: Sequence[str]) -> tuple[str, ...]:
        """Return the topics with messages of one of these types, sorted."""
        return tuple(sorted(t for t, found in self.topics.items() if set(found) & set(kinds)))

    def _require(self, topic: str, found: Sequence[object]) -> None:
        if not found:
            others = "one of " + (", ".join(sorted(self.topics)) or "no topic at all")
            raise DataError(self.path, "topic", f"no message on {topic}", others)

    def _typed(self, topic: str, kinds: Sequence[str]) -> Iterator[tuple[int, Record]]:
        """Yield the number of the file and each record; refuse a topic of another type."""
        for number, part in enumerate(self._parts):
            with faults(part.path):
                for record in part.records(topic):
                    kind = record.definition.kind
                    if kind not in kinds:
                        raise DataError(part.path, f"type of {topic}", kind, " or ".join(kinds))
                    yield number, record


def open_log(path: Path) -> Log:
    """Return the log of a file, or of a folder with `metadata.yaml`; nothing is read yet.

    Raises:
        DataError: the metadata is damaged, or names a file that is not there.
    """
    if path.is_dir():
        return Log(path, _parts(path))
    return Log(path, [McapFile(path) if path.suffix == MCAP else RosbagFile(path)])


def _parts(folder: Path) -> list[LogFile]:
    file = folder / METADATA
    content = read_yaml(file).get("rosbag2_bagfile_information")
    if not isinstance(content, dict):
        raise DataError(file, "rosbag2_bagfile_information", "missing", "metadata of a bag")
    names = content.get("relative_file_paths")
    if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
        raise DataError(file, "relative_file_paths", names, "the names of files")
    # recorders before Foxy wrote the folder's own name before each
    paths = [inside(folder, Path(name).name, follow_links=True) for name in names]
    for path in paths:
        if not path.is_file():
            raise MissingError(path, "file", "missing", f"a part of the recording ({METADATA})")
    packed = str(content.get("compression_mode", "")).lower() not in ("", "none")
    if all(path.suffix == MCAP for path in paths) and not packed:
        return [McapFile(path) for path in paths]
    return [RosbagFile(folder)]
