"""Track your own detections, from plain arrays, and write a nuScenes tracking submission.

python examples/track_own_detections.py submission.json
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mottrack import Objects
from mottrack.trackers import KalmanTracker


def my_detections() -> Iterator[tuple[str, Objects]]:
    """Sample token and boxes, world frame: put your detector's output here."""
    rng = np.random.default_rng(0)
    for k in range(20):
        stamp_ns = k * 500_000_000
        xy = np.array([[8.0 * 0.5 * k, 0.0], [20.0, 15.0], [10.0 + 0.7 * k, -6.0]])
        yield (
            f"sample-{k}",
            Objects(
                stamp_ns=stamp_ns,
                frame="world",
                centre_m=np.column_stack([xy + rng.normal(0, 0.2, xy.shape), [0.8, 0.8, 0.9]]),
                size_m=np.array([[4.5, 1.9, 1.6], [4.5, 1.9, 1.6], [0.7, 0.7, 1.8]]),  # l, w, h
                yaw_rad=rng.normal(0, 0.1, 3),
                label=np.array(["car", "car", "pedestrian"]),
                score=np.array([0.9, 0.6, 0.7]),
            ),
        )


def main(path: str) -> None:
    """Track them and write the submission to `path`."""
    tracker, results = KalmanTracker(), {}
    for token, objects in my_detections():
        tracks = tracker.step(objects.stamp_ns, objects)
        results[token] = [
            {
                "sample_token": token,
                "translation": tracks.centre_m[i].tolist(),
                "size": tracks.size_m[i, [1, 0, 2]].tolist(),  # w, l, h
                "rotation": [np.cos(tracks.yaw_rad[i] / 2), 0, 0, np.sin(tracks.yaw_rad[i] / 2)],
                "velocity": tracks.velocity_mps[i].tolist(),
                "tracking_id": str(tracks.id[i]),
                "tracking_name": str(tracks.label[i]),
                "tracking_score": float(tracks.score[i]),
            }
            for i in range(len(tracks))
        ]
    used = {
        f"use_{what}": what == "lidar" for what in ("camera", "lidar", "radar", "map", "external")
    }
    Path(path).write_text(json.dumps({"meta": used, "results": results}), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "submission.json")
