"""AB3DMOT (`pure-ab-3d-mot`): the package's defaults, one instance a class.

Its motion is per frame: velocities are divided by the time of the last step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from peer import Detected, Found, table
from pure_ab_3d_mot.tracker import Ab3DMot

FALLBACK_STEP_S = 0.5
"""Time of the first step, which has none before it: nuScenes' key frames."""
MOST_CLASSES = 100
"""More than any data set has: identities of different classes must differ."""


class _Prepared(NamedTuple):
    """The detections by class, and the time since the last frame."""

    of_class: dict[int, dict[str, np.ndarray]]
    step_s: float


class Ab3dMotPeer:
    """Boxes are turned into its camera axes and back."""

    def __init__(self) -> None:
        self._of_class: dict[int, Ab3DMot] = {}
        self._stamp_ns: int | None = None
        self._step_s = FALLBACK_STEP_S

    def prepared(self, seen: Detected) -> _Prepared:
        """Return boxes as it takes them; a class that was seen before is advanced as well."""
        before, self._stamp_ns = self._stamp_ns, seen.stamp_ns
        step_s = FALLBACK_STEP_S if before is None else (seen.stamp_ns - before) / 1e9
        for label in np.unique(seen.label).tolist():
            self._of_class.setdefault(label, Ab3DMot())
        boxes = {}
        for label in self._of_class:
            own = seen.label == label
            x, y, z, long, wide, high, yaw = seen.box[own].T
            # its y points down and z forward; a box is given by the centre of its bottom
            dets = np.column_stack([high, wide, long, x, -(z - high / 2), y, -yaw])
            info = np.column_stack([seen.score[own], np.zeros((own.sum(), 6))])
            boxes[label] = {"dets": dets, "info": info}
        return _Prepared(boxes, step_s)

    def step(self, prepared: _Prepared) -> Any:
        """Return its own rows, class by class."""
        self._step_s = prepared.step_s
        return {
            label: self._of_class[label].track(boxes)[0]
            for label, boxes in prepared.of_class.items()
        }

    def found(self, returned: Any) -> Found:
        """Return them in our axes."""
        rows = []
        for label, tracks in returned.items():
            live = self._of_class[label].trackers
            moved = {t.id: t.kf.x[[7, 9], 0] / self._step_s for t in live}
            for h, w, length, x, y, z, theta, identity, score in tracks[:, :9].tolist():
                place = (x, z, -y + h / 2, length, w, h, -theta)
                velocity = moved.get(int(identity), np.zeros(2))
                rows.append((*place, label, score, identity * MOST_CLASSES + label, *velocity))
        return table(rows)
