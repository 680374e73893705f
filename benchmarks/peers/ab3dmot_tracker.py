"""AB3DMOT (PyPI `pure-ab-3d-mot`) as a tracker plug-in, for stress and curves beside ours.

    pip install --no-deps pure-ab-3d-mot==2.2.0 association-quality-clavia==0.3.2 filterpy==2.0.0
    PYTHONPATH=benchmarks/peers mottrack stress demo flow=zero --out out/stress
        tracker=kalman,ab3dmot_tracker:Ab3dMotTracker

Its motion is per frame, so frames must be evenly spaced.
"""

from __future__ import annotations

import numpy as np
from ab3dmot_peer import Ab3dMotPeer
from peer import Detected

from mottrack.core.objects import Objects, Tracks


class Ab3dMotTracker:
    """The peer of `make peers`, on objects in place of arrays."""

    def __init__(self) -> None:
        self._peer = Ab3dMotPeer()
        self._labels: list[str] = []

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Advance every class by one frame."""
        self._labels += sorted(set(objects.label.tolist()) - set(self._labels))
        label = np.array([self._labels.index(name) for name in objects.label.tolist()], np.int64)
        box = np.column_stack([objects.centre_m, objects.size_m, objects.yaw_rad])
        prepared = self._peer.prepared(Detected(stamp_ns, box, label, objects.score))
        found = self._peer.found(self._peer.step(prepared))
        n = len(found.id)
        return Tracks(
            stamp_ns=stamp_ns,
            centre_m=found.box[:, :3],
            size_m=found.box[:, 3:6],
            yaw_rad=found.box[:, 6],
            label=np.array([self._labels[index] for index in found.label], np.str_),
            id=found.id,
            score=found.score,
            velocity_mps=found.velocity,
            velocity_covariance_m2ps2=np.tile(np.eye(2), (n, 1, 1)),
            state=np.zeros((n, 1)),
            covariance=np.ones((n, 1, 1)),
            observed=np.ones(n, np.bool_),
        )
