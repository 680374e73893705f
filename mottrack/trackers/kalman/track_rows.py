"""Live tracks beside their filters: identity, class, score, age and last hull."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.objects import Objects, Tracks


@dataclass(slots=True)
class TrackRows:
    """One row per live track, in order of initiation, as a structure of arrays."""

    id: I64
    label: I64
    """Index of the class."""
    score: F64
    """Of the last detection."""
    score_sum: F64
    """Over all its detections."""
    confidence: F64
    """Probability that there is an object, from all its scores."""
    hits: I64
    """Detections so far, in total."""
    velocities: I64
    """Measured velocities so far."""
    confirmed: Mask
    """Whether it has ever had as many detections as confirmation takes."""
    misses: I64
    """Steps since the last detection."""
    presence: F64
    """Probability that the object is still there (rule "existence")."""
    born_ns: I64
    """Stamp of the first detection."""
    seen_ns: I64
    """Stamp of the last detection."""
    source: I64
    """Row of this step's detection in the objects handed over; -1 while coasting."""

    @classmethod
    def empty(cls) -> TrackRows:
        """Return no track."""
        return new_tracks(0, np.empty(0, np.int64), np.empty(0), 0)

    def __len__(self) -> int:
        return len(self.id)

    def append(self, new: TrackRows) -> None:
        """Add the rows of other tracks."""
        for item in fields(self):
            joined = np.concatenate([getattr(self, item.name), getattr(new, item.name)])
            setattr(self, item.name, joined)

    def keep(self, mask: Mask) -> None:
        """Drop every row outside the mask (N,)."""
        for item in fields(self):
            setattr(self, item.name, getattr(self, item.name)[mask])


def new_tracks(first_id: int, label: I64, score: F64, stamp_ns: int) -> TrackRows:
    """Return rows of n new tracks with consecutive ids; label and score are (n,)."""
    n = len(label)
    return TrackRows(
        id=np.arange(first_id, first_id + n),
        label=label,
        score=score.copy(),
        score_sum=score.copy(),
        confidence=np.clip(score, 0.0, 1.0),
        hits=np.ones(n, np.int64),
        velocities=np.zeros(n, np.int64),
        confirmed=np.zeros(n, np.bool_),
        misses=np.zeros(n, np.int64),
        presence=np.ones(n),
        born_ns=np.full(n, stamp_ns, np.int64),
        seen_ns=np.full(n, stamp_ns, np.int64),
        source=np.full(n, -1, np.int64),
    )


class LastHulls:
    """The hull with which each live track was last detected: the filter's own state is a box."""

    def __init__(self) -> None:
        self._last: dict[int, tuple[F64, F64]] = {}

    def add_to(self, published: Tracks, live: TrackRows, objects: Objects) -> Tracks:
        """Return the published tracks with hulls, if this step's objects have hulls.

        A hull detected at this stamp stays where it was measured, another moves with its track's
        centre. `live` holds all live tracks, unpublished ones included.
        """
        if objects.hull is None:
            return published
        source = dict(zip(live.id.tolist(), live.source.tolist(), strict=True))
        self._last = {id_: self._last[id_] for id_ in source if id_ in self._last}
        for id_, row in source.items():
            if row >= 0:
                self._last[id_] = (objects.hull[row], objects.centre_m[row, :2])
        hulls = []
        for id_, centre_m in zip(published.id.tolist(), published.centre_m[:, :2], strict=True):
            if id_ not in self._last:
                return published
            hull, reference_m = self._last[id_]
            hulls.append(hull if source[id_] >= 0 else hull + (centre_m - reference_m))
        return replace(published, hull=tuple(hulls))
