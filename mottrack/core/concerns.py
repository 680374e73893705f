"""What is hardly meant although each value by itself is possible."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from mottrack.core.errors import MottrackError
from mottrack.core.printed import MAX_MESSAGE, printable


@dataclass(frozen=True)
class Concern:
    """A warning about data: what, how often, and one example.

    kind: a few words, the same for every concern of the kind.
    count: how many rows, frames or boxes.
    example: the first of them, with the place where it was found.
    """

    kind: str
    count: int
    example: str

    def __str__(self) -> str:
        return printable(f"{self.kind}: {self.count}, first {self.example}", MAX_MESSAGE)


class SceneConcern(NamedTuple):
    """A concern and the name of the scene that it was found in."""

    scene: str
    concern: Concern


def summaries(found: Iterable[SceneConcern]) -> list[str]:
    """Return one line per kind of concern: its number, the number of scenes, one example."""
    by_kind: dict[str, list[SceneConcern]] = {}
    for item in found:
        by_kind.setdefault(item.concern.kind, []).append(item)
    return [_summary(items) for items in by_kind.values()]


def _summary(found: Sequence[SceneConcern]) -> str:
    scene, first = found[0]
    count = sum(item.concern.count for item in found)
    scenes = f"{len(found)} scene{'s' if len(found) > 1 else ''}"
    text = f"{first.kind}: {count} in {scenes}, first in {scene} {first.example}"
    return printable(text, MAX_MESSAGE)


class ConcernError(MottrackError):
    """Warnings that were to be errors (`--strict`)."""

    def __init__(self, concerns: Iterable[Concern]) -> None:
        self.concerns = tuple(concerns)
        super().__init__("\n".join(f"error: {concern}" for concern in self.concerns))

    def __reduce__(self) -> tuple[type[ConcernError], tuple[tuple[Concern, ...]]]:
        return type(self), (self.concerns,)
