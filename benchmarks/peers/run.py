"""Run a peer on stored detections: `run.py PEER DETECTIONS.npz TRACKS.npz [FRAMES]`.

DETECTIONS has `stamp_ns` (T,), and by detection `frame`, `box` (x, y, z, l, w, h, yaw), `label`
(index of the class), `score`. TRACKS gets `frame` and the columns of `Found`. Printed are the
frames a second of CPU time; the first frames are left out: tracks are born there.
"""

from __future__ import annotations

import importlib
import json
import sys
import time

import numpy as np
from peer import Detected, Found

PEERS = {
    "kinematic-tracker": ("kinematic_peer", "KinematicPeer"),
    "pure-ab-3d-mot": ("ab3dmot_peer", "Ab3dMotPeer"),
    "norfair": ("norfair_peer", "NorfairPeer"),
    "stonesoup": ("stonesoup_peer", "StoneSoupPeer"),
}
"""Name on PyPI to module and class here."""
WARM_UP = 5
"""Frames that are not timed, where there are more."""


def main(name: str, detections: str, tracks: str, frames: str | None = None) -> None:
    module, kind = PEERS[name]
    peer = getattr(importlib.import_module(module), kind)()
    data = dict(np.load(detections))
    count = len(data["stamp_ns"]) if frames is None else int(frames)
    found: list[Found] = []
    took = np.zeros(count)
    for k in range(count):
        rows = data["frame"] == k
        columns = (data[column][rows] for column in ("box", "label", "score"))
        prepared = peer.prepared(Detected(int(data["stamp_ns"][k]), *columns))
        start = time.process_time()
        returned = peer.step(prepared)
        took[k] = time.process_time() - start
        found.append(peer.found(returned))
    stacked = {name: np.concatenate([getattr(f, name) for f in found]) for name in Found._fields}
    frame = np.repeat(np.arange(count), [len(f.id) for f in found])
    np.savez(tracks, frame=frame, **stacked)
    timed = took[WARM_UP:] if count > WARM_UP else took
    print(json.dumps({"frames_per_s": len(timed) / timed.sum()}))


if __name__ == "__main__":
    main(*sys.argv[1:])
