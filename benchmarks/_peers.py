"""Peers of the Kalman tracker run on stored detections, in the environment of `make peers`."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mottrack.core.objects import Objects
from mottrack.core.tables import TrackTable

HERE = Path(__file__).resolve().parent
PYTHON = HERE.parent / ".venv-peers" / "bin" / "python"
PEERS = ("kinematic-tracker", "pure-ab-3d-mot", "norfair", "stonesoup")
"""Names on PyPI; `peers/run.py` has the class of each."""


class PeerRun(NamedTuple):
    """What a peer made of a stream of detections."""

    tracks: TrackTable
    frames_per_s: float
    """Of CPU time, its own step alone."""


def run_peer(name: str, stream: list[Objects]) -> PeerRun | None:
    """Return the tracks of a peer and its speed; None, said on stderr, where it does not run."""
    if not PYTHON.exists():
        print(f"{name}: not installed, `make peers` installs it", file=sys.stderr)
        return None
    labels = sorted({name for objects in stream for name in objects.label.tolist()})
    with tempfile.TemporaryDirectory() as folder:
        detections, tracks = Path(folder) / "detections.npz", Path(folder) / "tracks.npz"
        np.savez(detections, **_columns(stream, labels))  # type: ignore[arg-type]
        script = str(HERE / "peers" / "run.py")
        command = [str(PYTHON), script, name, str(detections), str(tracks)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            print(f"{name}: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
            return None
        found = dict(np.load(tracks))
    return PeerRun(_table(found, labels), float(json.loads(done.stdout)["frames_per_s"]))


def _columns(stream: list[Objects], labels: list[str]) -> dict[str, np.ndarray]:
    position = {name: k for k, name in enumerate(labels)}
    return {
        "stamp_ns": np.array([objects.stamp_ns for objects in stream], np.int64),
        "frame": np.repeat(np.arange(len(stream)), [len(objects) for objects in stream]),
        "box": np.concatenate([np.column_stack([o.centre_m, o.size_m, o.yaw_rad]) for o in stream]),
        "label": np.array([position[n] for o in stream for n in o.label.tolist()], np.int64),
        "score": np.concatenate([o.score for o in stream]),
    }


def _table(found: dict[str, np.ndarray], labels: list[str]) -> TrackTable:
    n = len(found["id"])
    return TrackTable(
        frame=found["frame"],
        id=found["id"],
        label=np.array(labels)[found["label"]] if n else np.zeros(0, np.str_),
        centre_m=found["box"][:, :3],
        size_m=np.maximum(found["box"][:, 3:6], SMALLEST_M),
        yaw_rad=found["box"][:, 6],
        velocity_mps=found["velocity"],
        velocity_covariance_m2ps2=np.tile(np.eye(2), (n, 1, 1)),
        score=found["score"],
        observed=np.ones(n, np.bool_),
        hull_corners=np.zeros(n, np.int64),
    )


SMALLEST_M = 0.01
"""A linear filter may shrink a side below zero; no evaluation takes that."""
