"""Boxes of one segment as arrays, and the rules of the evaluation."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask

TYPES = ("VEHICLE", "PEDESTRIAN", "SIGN", "CYCLIST")
"""Numbered from 1 in the official files; 0 is unknown and not evaluated."""
LEVELS = (1, 2)
"""Difficulties: a true box that is harder than the level and not found is no miss."""
RANGES_M = (0.0, 30.0, 50.0, np.inf)
"""Of the official breakdown, from the vehicle in space."""


@dataclass(frozen=True, slots=True)
class WaymoRules:
    """The defaults are those of the official command."""

    min_iou: tuple[float, ...] = (0.7, 0.5, 0.5, 0.5)
    """3-D IoU of a match, by type."""
    cutoffs: tuple[float, ...] = (*(k * 0.01 for k in range(100)), 1.0)
    """Least scores of a box that are tried: the best MOTA counts."""


@dataclass(frozen=True, slots=True)
class SegmentBoxes:
    """N boxes of a segment, true or tracked, sorted by frame; within one in the order of the file.

    Boxes are in the vehicle's frame of their time.
    """

    frame: I64
    """(N,) index of the time."""
    id: I64
    """(N,) identity."""
    kind: I64
    """(N,) number of the type."""
    box: F64
    """(N, 7) x, y, z, length, width, height, heading."""
    score: F64
    """(N,) of a track box, 0 for truth."""
    level: I64
    """(N,) tracking difficulty of a true box, 0 where the file has none."""
    ignored: Mask
    """(N,) track boxes in a zone without labels: no false positives."""

    def __len__(self) -> int:
        return len(self.frame)

    def select(self, index: Mask) -> SegmentBoxes:
        """Return the rows that a mask picks."""
        return SegmentBoxes(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


class Segment(NamedTuple):
    """Truth and tracks of one segment."""

    name: str
    frames: int
    truth: SegmentBoxes
    tracks: SegmentBoxes


class Part(NamedTuple):
    """One row of the result: a type, in a range or in all."""

    kind: int
    low_m: float = 0.0
    high_m: float = np.inf

    @property
    def name(self) -> str:
        """The type, and the range where there is one."""
        kind = TYPES[self.kind - 1]
        if self.low_m == 0.0 and np.isinf(self.high_m):
            return kind
        return f"{kind} [{self.low_m:g}, {'+inf' if np.isinf(self.high_m) else f'{self.high_m:g}'})"

    def holds(self, boxes: SegmentBoxes) -> Mask:
        """Return which boxes belong to it, (N,); the range is that of the box itself."""
        range_m = np.sqrt((boxes.box[:, :3] ** 2).sum(axis=1))
        inside = (boxes.kind == self.kind) & (range_m >= self.low_m) & (range_m < self.high_m)
        return np.asarray(inside, np.bool_)


PARTS = (
    *(Part(k) for k in range(1, len(TYPES) + 1)),
    *(Part(k, low, high) for k in range(1, len(TYPES) + 1) for low, high in pairwise(RANGES_M)),
)
"""The official breakdowns OBJECT_TYPE and RANGE."""
