"""kinematic-tracker: one OpenCV Kalman filter a track, with the package's own defaults.

Constant velocity of the centre and constant size, the Mahalanobis similarity, Hungarian. The
package wants the noise of the measurement from its user.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from kinematic_tracker import NdKkfTracker
from peer import Detected, Found, table

CENTRE_SIGMA_M = 0.3
"""Of a LiDAR detector's centre: between a car's and a truck's in our own table."""
SIZE_SIGMA_M = 0.3
"""Likewise of its sides."""
CLASSES = 16
"""It wants their number; more than any data set here has."""


class KinematicPeer:
    """The heading, which a linear filter cannot carry, is that of the last detection."""

    def __init__(self) -> None:
        self._tracker = NdKkfTracker(orders_x=[2, 1], num_dims=[3, 3], num_cls=CLASSES)
        self._tracker.set_measurement_std_dev(0, CENTRE_SIGMA_M)
        self._tracker.set_measurement_std_dev(1, SIZE_SIGMA_M)
        self._last: dict[int, tuple[float, float]] = {}

    def prepared(self, seen: Detected) -> Detected:
        """Return the detections: it takes arrays."""
        return seen

    def step(self, prepared: Detected) -> Any:
        """Return the detections, and its tracks class by class."""
        rows = np.arange(len(prepared.box))
        self._tracker.advance(
            prepared.stamp_ns, np.ascontiguousarray(prepared.box[:, :6]), rows, cls_r=prepared.label
        )
        return prepared, self._tracker.tracks_c

    def found(self, returned: Any) -> Found:
        """Return the confirmed tracks."""
        seen, rows = returned[0], []
        for label, tracks in enumerate(returned[1]):
            for track in tracks:
                key, row = track.creation_id, track.upd_id
                if row >= 0:
                    self._last[key] = (seen.box[row, 6], seen.score[row])
                if track.id < 0:
                    continue
                state, (yaw, score) = track.kkf.kalman_filter.statePost[:, 0], self._last[key]
                box = (state[0], state[2], state[4], *state[6:9], yaw)
                rows.append((*box, label, score, key, state[1], state[3]))
        return table(rows)
