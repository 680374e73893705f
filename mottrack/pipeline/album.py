"""Chooses the frames of a scene that are kept for pictures."""

from __future__ import annotations

from dataclasses import dataclass, field

from mottrack.core.motion import FlowField
from mottrack.core.snapshot import Snapshot
from mottrack.core.sweep import Sweep


@dataclass
class Album:
    """Takes the first key frame at or after each of a few moments, evenly spread over a scene."""

    moments: list[int]
    """Frame indices that are still to be taken, the next one last."""
    snapshots: list[Snapshot] = field(default_factory=list)

    @classmethod
    def of(cls, count: int, frames: int) -> Album:
        """An album of ``count`` pictures of a scene of so many frames; one is its middle."""
        return cls([round(frames * (k + 0.5) / count) for k in reversed(range(count))])

    def take(self, index: int, row: int, sweep: Sweep | None, field: FlowField | None) -> None:
        """Keeps the key frame at ``index``, row ``row`` of the FrameTable, if its turn has come."""
        if sweep is None or not self.moments or index < self.moments[-1]:
            return
        while self.moments and index >= self.moments[-1]:
            self.moments.pop()
        self.snapshots.append(Snapshot.of(row, sweep, field))
