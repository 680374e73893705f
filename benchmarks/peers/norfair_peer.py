"""norfair: centres in the plane, its Kalman filter, greedy by distance, within a class."""

from __future__ import annotations

from typing import Any

import numpy as np
from norfair import Detection, Tracker
from peer import Detected, Found, table

GATE_M = 3.0
"""A road user at 30 m/s moves that far in a tenth of a second."""
HITS = 5
"""Frames that a track outlives without a detection, at most."""


class NorfairPeer:
    """A track takes everything but its centre from its last detection."""

    def __init__(self) -> None:
        self._tracker = Tracker(
            distance_function="euclidean",
            distance_threshold=GATE_M,
            initialization_delay=1,
            hit_counter_max=HITS,
        )

    def prepared(self, seen: Detected) -> list[Detection]:
        """Return a point for each detection, with its box."""
        rows = zip(seen.box, seen.label.tolist(), seen.score.tolist(), strict=True)
        return [Detection(points=b[None, :2], data=(b, s), label=c) for b, c, s in rows]

    def step(self, prepared: list[Detection]) -> Any:
        """Return the tracked objects that are confirmed."""
        return self._tracker.update(detections=prepared)

    def found(self, returned: Any) -> Found:
        """Return their estimates."""
        rows = []
        for one in returned:
            box, score = one.last_detection.data
            place = (*one.estimate[0], *box[2:])
            rows.append((*place, one.label, score, one.id, np.nan, np.nan))
        return table(rows)
