"""C: faults that once ended in a traceback of Python or of a library."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from mottrack.trackers import KalmanTracker
from tests.fuzz.faults.finished import times
from tests.fuzz.faults.printed import (
    Faults,
    Printed,
    changed,
    experiment,
    fed,
    frame,
    raised,
    record,
    replaced,
    rows,
)
from tests.fuzz.targets import TARGETS

NINES = "9" * 5000
BRACKETS = b"[" * 100_000
ICP = ("flow=cluster_icp",)


def damaged(name: str, damage: str) -> Printed:
    """Damage a file by one of the damages of its format."""
    change = TARGETS[name].damages[damage]
    return changed(name, lambda data: change(data, np.random.default_rng(0)).data)


def broken_plug_in(root: Path) -> str:
    (root / "broken_plug_in.py").write_text("def (:\n")
    sys.path.insert(0, str(root))
    try:
        return experiment("name: a\n", "flow=broken_plug_in:Y")(root)
    finally:
        sys.path.remove(str(root))


FAULTS: Faults = {
    "C1 `name: 2024-99-99`, a text": experiment("name: 2024-99-99\n", "flow=zero"),
    "C2 YAML with a number of 5,000 digits": experiment(f"pair_s: {NINES}\n"),
    "C2 the same as an override": experiment("name: a\n", f"dataset.scenes={NINES}"),
    "C3 `!!bool maybe`": experiment("name: !!bool maybe\n"),
    "C4 `flow=.x:Y`": experiment("name: a\n", "flow=.x:Y"),
    "C5 a plug-in with a syntax error": broken_plug_in,
    "C6 an npz that is none": changed("own sweep", lambda _: b"PK\x03\x04 and no more"),
    "C6 an npz that is an npy": damaged("own sweep", "npy"),
    "C6 an encrypted npz": damaged("own sweep", "encrypted"),
    "C6 an npz of another compression": damaged("own sweep", "other packing"),
    "C6 a height npy of a huge shape": damaged("argoverse2 heights", "huge shape"),
    "C6 a height npy of objects": damaged("argoverse2 heights", "objects"),
    "C6 a height npy of text": damaged("argoverse2 heights", "text"),
    "C7 an integer of 5,000 digits in KITTI labels": rows(
        "kitti labels", lambda r: [f"{NINES} {r[0].split(maxsplit=1)[1]}", *r[1:]]
    ),
    "C7 in a MOT text": rows("mot tracks", lambda r: [NINES + r[0][1:], *r[1:]]),
    "C7 in a csv": rows("own poses", lambda r: [r[0], NINES + r[1], *r[2:]]),
    "C7 in JSON": replaced("nuscenes sample", '"timestamp":', f'"timestamp": {NINES}, "other":'),
    "C8 `[` x 100,000 in a nuScenes table": changed("nuscenes sample", lambda _: BRACKETS),
    "C8 in nuScenes detections": changed("nuscenes detections", lambda _: BRACKETS),
    "C8 in a submission": changed("nuscenes submission", lambda _: BRACKETS),
    "C8 in a detector's export": changed("detector json", lambda _: BRACKETS),
    "C8 in a map's transform": changed("argoverse2 transform", lambda _: BRACKETS),
    "C8 in timings of a run": times("timings.json", BRACKETS.decode()),
    "C9 `num_lidar_pts` of 2^64 - 1": record("nuscenes annotations", num_lidar_pts=2**64 - 1),
    "C10 half a surrogate pair": record("nuscenes sample_data", filename="\ud800"),
    "C11 a file name of 5,000 characters": record("nuscenes sample_data", filename="a" * 5000),
    "C12 texts in timings": times("timings.json", '{"a": ["1"]}'),
    "C12 NaN in timings": times("timings.json", '{"a": [NaN]}'),
    "C12 texts in latency files": times("latency.json", '{"a": "text"}'),
    "C12 NaN in latency files": times("latency.json", '{"a": [NaN]}'),
    "C13 points as text through `feed`": fed(ICP, frame(1, points="points")),
    "C13 points of ragged rows": fed(ICP, frame(1, points=[[1.0, 2.0, 3.0], [1.0]])),
    "C13 points as a dict": fed(ICP, frame(1, points={"x": [1.0]})),
    "C14 `step(t, None)`": raised(lambda _: KalmanTracker().step(0, None)),  # type: ignore[arg-type]
}
