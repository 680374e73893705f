"""norfair on a stored workload: `run_norfair.py WORKLOAD.npz FRAMES` prints frames a second."""

import json
import sys
import time

import numpy as np
from norfair import Detection, Tracker

WARM_UP = 5
GATE_M = 3.0


def main(path: str, frames: int) -> None:
    data = dict(np.load(path))
    stream = []
    for k in range(frames):
        rows = data["frame"] == k
        centres, labels = data["box"][rows, :2], data["label"][rows].tolist()
        stream.append(
            [Detection(points=p[None], label=c) for p, c in zip(centres, labels, strict=True)]
        )
    tracker = Tracker(
        distance_function="euclidean",
        distance_threshold=GATE_M,
        initialization_delay=1,
        hit_counter_max=5,
    )
    for detections in stream[:WARM_UP]:
        tracker.update(detections=detections)
    start = time.process_time()
    for detections in stream[WARM_UP:]:
        tracker.update(detections=detections)
    speed = (frames - WARM_UP) / (time.process_time() - start)
    print(json.dumps({"frames_per_s": speed}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
