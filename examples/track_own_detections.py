"""Track your own detections, from a csv file, and write a nuScenes tracking submission.

python examples/track_own_detections.py examples/detections.csv submission.json
"""

import csv
import json
import sys
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import numpy as np

from mottrack import Objects, Tracks
from mottrack.trackers import KalmanTracker


def frames(path: str) -> Iterator[tuple[str, Objects]]:
    """Sample token and boxes, world frame, of each stamp; rows are in order of time."""
    with Path(path).open(encoding="utf-8", newline="") as file:
        for (stamp, token), group in groupby(
            csv.DictReader(file), lambda row: (row["stamp_ns"], row["token"])
        ):
            rows = list(group)
            yield (
                token,
                Objects(
                    stamp_ns=int(stamp),
                    frame="world",
                    centre_m=numbers(rows, "x", "y", "z"),
                    size_m=numbers(rows, "length", "width", "height"),
                    yaw_rad=numbers(rows, "yaw")[:, 0],
                    label=np.array([row["label"] for row in rows]),
                    score=numbers(rows, "score")[:, 0],
                ),
            )


def numbers(rows: list[dict[str, str]], *names: str) -> np.ndarray:
    """(N, len(names)) the columns of these names."""
    return np.array([[float(row[name]) for name in names] for row in rows])


def entries(token: str, tracks: Tracks) -> list[dict[str, object]]:
    """The tracks of one sample as a submission holds them."""
    return [
        {
            "sample_token": token,
            "translation": tracks.centre_m[i].tolist(),
            "size": tracks.size_m[i, [1, 0, 2]].tolist(),  # width, length, height
            "rotation": [np.cos(tracks.yaw_rad[i] / 2), 0, 0, np.sin(tracks.yaw_rad[i] / 2)],
            "velocity": tracks.velocity_mps[i].tolist(),
            "tracking_id": str(tracks.id[i]),
            "tracking_name": str(tracks.label[i]),
            "tracking_score": float(tracks.score[i]),
        }
        for i in range(len(tracks))
    ]


def main(source: str, target: str) -> None:
    """Track one scene and write the submission."""
    tracker, results = KalmanTracker(), {}
    for token, objects in frames(source):
        results[token] = entries(token, tracker.step(objects.stamp_ns, objects))
    used = {
        f"use_{what}": what == "lidar" for what in ("camera", "lidar", "radar", "map", "external")
    }
    Path(target).write_text(json.dumps({"meta": used, "results": results}), encoding="utf-8")
    print(f"{target}: {sum(map(len, results.values()))} boxes in {len(results)} samples")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
