"""Bookkeeping of live tracks: identity, class, score and age, as structure of arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask


@dataclass(slots=True)
class TrackRows:
    """One row a live track, in order of birth."""

    id: I64
    label: I64
    """Index of the class."""
    score: F64
    """Of the last detection."""
    score_sum: F64
    """Over all its detections."""
    confidence: F64
    """Belief that there is an object, from all its scores."""
    hits: I64
    """Detections so far, in total."""
    confirmed: Mask
    """Whether it has ever had as many as it takes to be put out."""
    misses: I64
    """Steps since the last detection."""
    born_ns: I64
    """Stamp of the first detection."""
    seen_ns: I64
    """Stamp of the last detection."""
    flips: I64
    """Evidence for the present heading against the opposite one."""
    source: I64
    """Row of this step's detection in the objects handed over; -1 while coasting."""

    @classmethod
    def empty(cls) -> TrackRows:
        """No track."""
        nothing = np.empty(0, np.int64)
        return new_tracks(0, nothing, nothing.astype(np.float64), 0)

    def __len__(self) -> int:
        return len(self.id)

    def append(self, new: TrackRows) -> None:
        """Adds the rows of another book."""
        for item in fields(self):
            joined = np.concatenate([getattr(self, item.name), getattr(new, item.name)])
            setattr(self, item.name, joined)

    def keep(self, mask: NDArray[Any]) -> None:
        """Drops every row outside the mask."""
        for item in fields(self):
            setattr(self, item.name, getattr(self, item.name)[mask])


def new_tracks(first_id: int, label: I64, score: F64, stamp_ns: int) -> TrackRows:
    """Rows of n new tracks with consecutive ids."""
    n = len(label)
    return TrackRows(
        id=np.arange(first_id, first_id + n),
        label=label,
        score=score.copy(),
        score_sum=score.copy(),
        confidence=np.clip(score, 0.0, 1.0),
        hits=np.ones(n, np.int64),
        confirmed=np.zeros(n, np.bool_),
        misses=np.zeros(n, np.int64),
        born_ns=np.full(n, stamp_ns, np.int64),
        seen_ns=np.full(n, stamp_ns, np.int64),
        flips=np.zeros(n, np.int64),
        source=np.full(n, -1, np.int64),
    )
