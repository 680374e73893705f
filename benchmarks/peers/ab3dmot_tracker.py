"""AB3DMOT (PyPI `pure-ab-3d-mot`) as a tracker plug-in, for stress and curves beside ours.

    pip install --no-deps pure-ab-3d-mot==2.2.0 association-quality-clavia==0.3.2 filterpy==2.0.0
    PYTHONPATH=benchmarks/peers mottrack stress demo flow=zero --out out/stress
        tracker=kalman,ab3dmot_tracker:Ab3dMotTracker

Settings are the package's defaults (GIoU -0.2, three hits, two misses), the same for each class,
which has an instance of its own. Its motion is per frame: velocities are divided by the time of the
last step, so frames must be evenly spaced.
"""

from __future__ import annotations

import numpy as np
from pure_ab_3d_mot.tracker import Ab3DMot

from mottrack.core.objects import Objects, Tracks
from mottrack.core.sweep import seconds_between

FALLBACK_STEP_S = 0.5
"""Time of the first step, which has none before it: nuScenes' key frames."""


MOST_CLASSES = 100
"""More than any data set has."""


class Ab3dMotTracker:
    """One AB3DMOT instance for each class; boxes are turned into its camera axes and back."""

    def __init__(self) -> None:
        self._of_class: dict[str, Ab3DMot] = {}
        self._stamp_ns: int | None = None

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Advance every class by one frame."""
        before, self._stamp_ns = self._stamp_ns, stamp_ns
        step_s = FALLBACK_STEP_S if before is None else seconds_between(before, stamp_ns)
        labels = sorted({*self._of_class, *np.unique(objects.label).tolist()})
        rows = [row for label in labels for row in self._rows(label, objects, step_s)]
        n = len(rows)
        table = np.array([row[1:] for row in rows], np.float64).reshape(n, 11)
        return Tracks(
            stamp_ns=stamp_ns,
            centre_m=table[:, :3],
            size_m=table[:, 3:6],
            yaw_rad=table[:, 6],
            label=np.array([row[0] for row in rows], np.str_),
            id=table[:, 7].astype(np.int64),
            score=table[:, 8],
            velocity_mps=table[:, 9:11],
            velocity_covariance_m2ps2=np.tile(np.eye(2), (n, 1, 1)),
            state=np.zeros((n, 1)),
            covariance=np.ones((n, 1, 1)),
            observed=np.ones(n, np.bool_),
        )

    def _rows(self, label: str, objects: Objects, step_s: float) -> list[tuple]:
        """Rows of one class: label, centre, size, yaw, identity, score, velocity."""
        tracker = self._of_class.setdefault(label, Ab3DMot())
        own = objects.select(np.flatnonzero(objects.label == label))
        (x, y, z), (long, wide, high) = own.centre_m.T, own.size_m.T
        # its y points down and z forward; a box is given by the centre of its bottom
        boxes = np.column_stack([high, wide, long, x, -(z - high / 2), y, -own.yaw_rad])
        info = np.column_stack([own.score, np.zeros((len(own), 6))])
        found = tracker.track({"dets": boxes, "info": info})[0]
        moved = {t.id: t.kf.x[[7, 9], 0] / step_s for t in tracker.trackers}
        rows = []
        for row in found:
            h, w, length, cx, cy, cz, theta, identity, score = row[:9]
            place = (cx, cz, -cy + h / 2, length, w, h, -theta)
            # identities of different classes must differ, and stay when a class appears later
            unique = int(identity) * MOST_CLASSES + list(self._of_class).index(label)
            velocity = moved.get(int(identity), np.zeros(2))
            rows.append((label, *place, unique, score, *velocity))
        return rows
