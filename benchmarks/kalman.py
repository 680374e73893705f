"""Frames a second of the Kalman tracker's engines and of its peers, on one core.

All track the same stored workload: road users of seven classes at a constant density, 10 Hz, a
recall of 95 %. Ours track eleven numbers of each; norfair and Stone Soup, which have no boxes,
track the centre in the plane. The peers need `make peers` and are left out without it.

CPU time (`time.process_time`), the first frames left out: tracks are born there.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.update({"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"})

import numpy as np
from _common import arguments, report

from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Objects
from mottrack.trackers import KalmanTracker

CLASSES = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")
STEP_NS = 100_000_000
SPACING_M = 7.0
WARM_UP = 5
HERE = Path(__file__).resolve().parent
PEER_PYTHON = HERE.parent / ".venv-peers" / "bin" / "python"
LADDER = (60, 300, 1000)
PEERS = ("norfair", "stonesoup")

OURS: dict[str, dict[str, Any]] = {
    "mottrack published preset": {"preset": "stanford_iprl_tri"},
    "mottrack default": {},
    "mottrack default, velocities": {},
    "filterpy engine": {"preset": "stanford_iprl_tri", "engine": "filterpy"},
}


def workload(count: int, frames: int) -> dict[str, np.ndarray]:
    """Arrays by detection: frame, box (x, y, z, l, w, h, yaw), class, score, velocity."""
    rng = np.random.default_rng(count)
    side = SPACING_M * np.sqrt(count)
    place, speed = rng.uniform(0, side, (count, 2)), rng.normal(0, 4, (count, 2))
    label, yaw = np.arange(count) % len(CLASSES), rng.uniform(-np.pi, np.pi, count)
    rows = []
    for k in range(frames):
        seen = np.flatnonzero(rng.random(count) < 0.95)
        xy = place[seen] + 0.1 * k * speed[seen] + rng.normal(0, 0.15, (len(seen), 2))
        box = np.column_stack(
            [xy, np.zeros(len(seen)), np.tile([4, 1.8, 1.6], (len(seen), 1)), yaw[seen]]
        )
        velocity = speed[seen] + rng.normal(0, 0.5, (len(seen), 2))
        extra = [np.full(len(seen), k), label[seen], rng.uniform(0.3, 1, len(seen))]
        rows.append(np.column_stack([*extra, box, velocity]))
    table = np.concatenate(rows)
    return {
        "frame": table[:, 0].astype(int),
        "label": table[:, 1].astype(int),
        "score": table[:, 2],
        "box": table[:, 3:10],
        "velocity": table[:, 10:],
    }


def objects_of(data: dict[str, np.ndarray], frame: int, *, moving: bool) -> Objects:
    rows = data["frame"] == frame
    box, n = data["box"][rows], int(rows.sum())
    velocity = None
    if moving:
        spread = np.tile([[0.3, 0.1], [0.1, 0.2]], (n, 1, 1))
        velocity = VelocityMeasurement(data["velocity"][rows], spread, np.ones(n, bool))
    return Objects(
        stamp_ns=frame * STEP_NS,
        frame="world",
        centre_m=box[:, :3],
        size_m=box[:, 3:6],
        yaw_rad=box[:, 6],
        label=np.array(CLASSES)[data["label"][rows]],
        score=data["score"][rows],
        velocity=velocity,
    )


def time_ours(data: dict[str, np.ndarray], frames: int, name: str) -> float:
    """Frames a second."""
    stream = [objects_of(data, k, moving="velocities" in name) for k in range(frames)]
    tracker = KalmanTracker(KalmanTracker.Config(**OURS[name]))
    for objects in stream[:WARM_UP]:
        tracker.step(objects.stamp_ns, objects)
    start = time.process_time()
    for objects in stream[WARM_UP:]:
        tracker.step(objects.stamp_ns, objects)
    return (frames - WARM_UP) / (time.process_time() - start)


def time_peer(stored: Path, frames: int, name: str) -> float | None:
    """Frames a second of a peer in its own environment; None where it is not installed."""
    if not PEER_PYTHON.exists():
        return None
    command = [str(PEER_PYTHON), str(HERE / "peers" / f"run_{name}.py"), str(stored), str(frames)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        print(f"{name}: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
        return None
    return float(json.loads(done.stdout)["frames_per_s"])


def measure(count: int, repeats: int, *, quick: bool) -> list[dict[str, Any]]:
    """One row a tracker: frames a second at that many objects."""
    frames = 30 if quick else 60
    data, rows = workload(count, frames), []
    reference = None
    for name in OURS:
        slow = name == "filterpy engine"
        n = WARM_UP + 5 if slow else frames
        best = max(time_ours(data, n, name) for _ in range(1 if slow else repeats))
        rows.append({"objects": count, "tracker": name, "frames/s": best})
        reference = best if name == "mottrack default" else reference
    with tempfile.TemporaryDirectory() as folder:
        stored = Path(folder) / "workload.npz"
        np.savez(stored, **data)
        for name in PEERS:
            n = WARM_UP + (5 if name == "norfair" or count <= 100 else 2)
            speed = time_peer(stored, n, name)
            rows.append({"objects": count, "tracker": name, "frames/s": speed or float("nan")})
    for row in rows:
        row["ms a frame"] = 1e3 / row["frames/s"]
        row["default is faster by"] = (reference or 0.0) / row["frames/s"]
    return rows


def growth(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The power of the number of objects by which a frame's time grows: 1 is linear."""
    found = []
    for name in dict.fromkeys(row["tracker"] for row in rows):
        mine = [row for row in rows if row["tracker"] == name and row["objects"] in LADDER]
        count = np.array([row["objects"] for row in mine], float)
        took = np.array([row["ms a frame"] for row in mine])
        power = np.polyfit(np.log(count), np.log(took), 1)[0] if len(mine) > 1 else np.nan
        found.append({"tracker": name, "time grows with objects to the power": float(power)})
    return found


def main() -> None:
    options = arguments(__doc__ or "")
    sizes = (60, 70, 420) if options.quick else (60, 70, 300, 420, 1000)
    repeats = 2 if options.quick else 5
    time_ours(workload(60, 10), 10, "mottrack default")  # compiles what is compiled
    rows = [row for n in sizes for row in measure(n, repeats, quick=options.quick)]
    report(rows, options.json)
    report(growth(rows), None)


if __name__ == "__main__":
    main()
