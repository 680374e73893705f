"""Shards: parts of a run for machines that know nothing of each other, and their record."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self, TypeVar

from mottrack.core.errors import ConfigError, ResultError
from mottrack.core.storage import write_text

T = TypeVar("T")
RECORD = "shards.json"


@dataclass(frozen=True, order=True)
class Shard:
    """Every ``count``-th scene of a run, from number ``index`` on: ``2/5`` is the second of five.

    Neighbouring scenes of a data set, which are often alike in length, go to different shards.

    Raises:
        ConfigError: the index is not one of 1 .. count.
    """

    index: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.index <= self.count:
            raise ConfigError(f"shard is {self}, expected I/N with I from 1 to N")

    def __str__(self) -> str:
        return f"{self.index}/{self.count}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read ``I/N``.

        Raises:
            ConfigError: it is not of that form.
        """
        index, _, count = text.partition("/")
        if not (index.isdecimal() and count.isdecimal()):
            raise ConfigError(f"shard is {text!r}, expected I/N such as 1/5")
        return cls(int(index), int(count))

    @property
    def whole(self) -> bool:
        """Whether it is all of the run."""
        return self.count == 1

    def of(self, items: Sequence[T]) -> tuple[T, ...]:
        """Return its part of the scenes of a run, or of other items, given in order."""
        return tuple(items[self.index - 1 :: self.count])


@dataclass(frozen=True)
class ShardRecord:
    """What became of one shard of a run."""

    shard: Shard
    scenes: tuple[str, ...]
    """In the order of the data set."""
    failed: Mapping[str, str]
    """Failed scenes to the reason."""
    row: int = 0
    """Place of the run among those that were run together: that of its row in tables."""


def write_record(folder: Path, record: ShardRecord) -> None:
    """Add the record of a shard to those of a run's folder."""
    known = {part.shard: part for part in read_records(folder)} | {record.shard: record}
    plain = {
        str(part.shard): {"row": part.row, "scenes": part.scenes, "failed": dict(part.failed)}
        for part in known.values()
    }
    write_text(folder / RECORD, json.dumps(plain, indent=1) + "\n")


def read_records(folder: Path) -> list[ShardRecord]:
    """Read the records of the shards that were run into a folder; none where none was.

    Raises:
        ResultError: the file is damaged.
    """
    path = folder / RECORD
    if not path.is_file():
        return []
    try:
        return [
            ShardRecord(
                Shard.parse(name), tuple(part["scenes"]), dict(part["failed"]), int(part["row"])
            )
            for name, part in json.loads(path.read_text(encoding="utf-8")).items()
        ]
    except (ValueError, KeyError, TypeError, AttributeError, ConfigError) as error:
        raise ResultError(path, "content", repr(error), "records of shards") from error
