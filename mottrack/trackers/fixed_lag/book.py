"""What is known of each track besides its motion state: identity, appearance, history."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mottrack.core.objects import Objects
from mottrack.trackers.fixed_lag.motion import F64


@dataclass(slots=True)
class Entry:
    """One live track as it was last seen."""

    id: int
    label: str
    score: float
    size_m: F64
    """(3,) length, width, height."""
    yaw_rad: float
    z_m: float
    reference_m: F64
    """(2,) measured position, to which the hull belongs."""
    hull: F64 | None
    """(K, 2)."""
    hits: int
    seen_ns: int
    held_ns: int = -1
    """Since when the track has been part of a merged cluster; -1 where it is not."""
    split_ns: int = -1
    """Since when the track has been seen in pieces; -1 where it is seen whole."""


class TrackBook:
    """Live tracks by slot. Slots are reused, smallest first; identities never."""

    def __init__(self) -> None:
        self.entries: dict[int, Entry] = {}
        self._free: list[int] = []
        self._slots = 0
        self._ids = 0

    def __len__(self) -> int:
        return len(self.entries)

    def slots(self) -> NDArray[np.int64]:
        """(N,) slots of all live tracks, ascending."""
        return np.array(sorted(self.entries), np.int64)

    def reserve(self, count: int) -> NDArray[np.int64]:
        """(count,) free slots; those that get no entry must be handed back."""
        taken = [heapq.heappop(self._free) if self._free else self._next() for _ in range(count)]
        return np.array(taken, np.int64)

    def _next(self) -> int:
        self._slots += 1
        return self._slots - 1

    def hand_back(self, slot: int) -> None:
        """Ends a track, or gives up a reserved slot."""
        self.entries.pop(slot, None)
        heapq.heappush(self._free, slot)

    def see(self, slot: int, objects: Objects, row: int) -> None:
        """Notes that the track in `slot` was seen as row `row`; a new slot begins a track."""
        old = self.entries.get(slot)
        if old is None:
            self._ids += 1
        self.entries[slot] = Entry(
            id=self._ids if old is None else old.id,
            label=str(objects.label[row]),
            score=float(objects.score[row]),
            size_m=objects.size_m[row],
            yaw_rad=float(objects.yaw_rad[row]),
            z_m=float(objects.centre_m[row, 2]),
            reference_m=objects.centre_m[row, :2],
            hull=None if objects.hull is None else objects.hull[row],
            hits=1 if old is None else old.hits + 1,
            seen_ns=objects.stamp_ns,
            split_ns=-1 if old is None else old.split_ns,
        )

    def labels(self, slots: NDArray[np.int64]) -> NDArray[np.str_]:
        """(N,) class names."""
        return np.array([self.entries[slot].label for slot in slots.tolist()], np.str_)
