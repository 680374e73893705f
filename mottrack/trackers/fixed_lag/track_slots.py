"""Live tracks beside their motion state: identity, size, score, hull and history."""

from __future__ import annotations

import heapq
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.objects import Objects
from mottrack.trackers.fixed_lag.merge_split import HullList, flat

_ROW = np.dtype(
    [
        ("id", np.int64),
        ("label", np.int64),  # number of the class name
        ("score", np.float64),
        ("size_m", np.float64, 3),
        ("yaw_rad", np.float64),
        ("z_m", np.float64),
        ("reference_m", np.float64, 2),  # measured position, to which the hull belongs
        ("hits", np.int64),
        ("velocity_known", np.bool_),  # measured, or seen at two stamps
        ("extra_hits", np.int64),  # detections needed for output beyond `min_hits`
        ("seen_ns", np.int64),
        ("merged_ns", np.int64),  # since when part of a merged cluster; -1 where it is not
        ("split_ns", np.int64),  # since when seen in pieces; -1 where it is seen whole
    ]
)


class TrackSlots:
    """Live tracks by slot. Slots are reused, smallest first; identities never."""

    def __init__(self) -> None:
        self._rows = np.zeros(0, _ROW)
        self._alive = np.zeros(0, np.bool_)
        self._hulls: list[F64 | None] = []
        self._labels: dict[str, int] = {}
        self._free: list[int] = []
        self._ids = 0

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column by slot, (S, ...); rows of free slots are undefined."""
        return self._rows[name]

    def slots(self) -> I64:
        """Return the slots (N,) of all live tracks, ascending."""
        return np.flatnonzero(self._alive)

    def reserve(self, count: int) -> I64:
        """Return free slots (count,); those that get no track must be released."""
        missing = count - len(self._free)
        if missing > 0:
            have = len(self._rows)
            self._free += range(have, have + missing)
            self._rows = np.concatenate([self._rows, np.zeros(missing, _ROW)])
            self._alive = np.concatenate([self._alive, np.zeros(missing, np.bool_)])
            self._hulls += [None] * missing
        return np.array([heapq.heappop(self._free) for _ in range(count)], np.int64)

    def release(self, slot: int) -> None:
        """Delete a track, or give up a reserved slot."""
        self._alive[slot] = False
        self._hulls[slot] = None
        heapq.heappush(self._free, slot)

    def record(self, slots: I64, objects: Objects, rows: I64) -> None:
        """Record that the track in each slot (N,) was seen as an object; new slots start tracks."""
        fresh = ~self._alive[slots]
        born = slots[fresh]
        self._rows["id"][born] = self._ids + 1 + np.arange(len(born))
        self._rows["hits"][born] = 0
        self._rows["velocity_known"][born] = False
        self._rows["extra_hits"][born] = 0
        self._rows["split_ns"][born] = -1
        self._ids += len(born)
        self._alive[slots] = True
        seen = {
            "label": self.label_numbers(objects.label)[rows],
            "score": objects.score[rows],
            "size_m": objects.size_m[rows],
            "yaw_rad": objects.yaw_rad[rows],
            "z_m": objects.centre_m[rows, 2],
            "reference_m": objects.centre_m[rows, :2],
            "hits": self._rows["hits"][slots] + 1,
            "seen_ns": objects.stamp_ns,
            "merged_ns": -1,
        }
        for name, value in seen.items():
            self._rows[name][slots] = value
        for slot, row in zip(slots.tolist(), rows.tolist(), strict=True):
            self._hulls[slot] = None if objects.hull is None else objects.hull[row]

    def label_numbers(self, labels: Texts) -> I64:
        """Return the numbers (M,) of class names, as in the column "label"."""
        names, which = np.unique(labels, return_inverse=True)
        numbers = [self._labels.setdefault(str(name), len(self._labels)) for name in names]
        return np.array(numbers, np.int64)[which]

    def labels(self, slots: I64) -> Texts:
        """Return the class names (N,)."""
        numbers: I64 = self._rows["label"][slots]
        return np.array(list(self._labels), np.str_)[numbers]

    def hulls_at(self, slots: I64, shift_m: F64) -> HullList | None:
        """Return the last hulls, each moved by `shift_m` (N, 2); None where a track has none."""
        hulls = [self._hulls[slot] for slot in slots.tolist()]
        known = [hull for hull in hulls if hull is not None]
        if len(known) < len(hulls):
            return None
        corner_m, start = flat(known)
        moved_m = corner_m + np.repeat(shift_m, np.diff(start), axis=0)
        moved_m.flags.writeable = False
        return HullList(moved_m, start)
