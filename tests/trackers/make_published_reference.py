"""Make `published_reference.npz` with the prototype of the published tracker.

    python tests/trackers/make_published_reference.py PATH/TO/kalman_bank.py

The prototype follows the code of StanfordIPRL-TRI (Chiu et al., 2020) line by line for one class;
here are seven of them, sharing one counter of identities as the original does. The file holds its
inputs too, so the test needs neither the prototype nor a generator of random numbers.
"""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
from conftest import CLASSES, make_workload

from mottrack.trackers.kalman.noise_tables import TABLES

HERE = Path(__file__).resolve().parent
FRAMES, CROWD, SEED = 50, 22, 0


def load(path: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location("kalman_bank", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main() -> None:
    prototype, noise = load(sys.argv[1]), TABLES["chiu2020-megvii"]
    trackers = [
        prototype.T(noise[c].initial, noise[c].process, noise[c].observation) for c in CLASSES
    ]
    next_id, inputs, outputs = 0, [], []
    for frame, objects in enumerate(make_workload(SEED, FRAMES, CROWD)):
        box = np.column_stack([objects.centre_m, objects.yaw_rad, objects.size_m])
        # stored in single precision: numbers that both trackers read alike, in half the bytes
        box, score = box.astype(np.float32), objects.score.astype(np.float32)
        for k, name in enumerate(CLASSES):
            mine = objects.label == name
            n = int(mine.sum())
            if n == 0:
                continue
            columns = [np.full(n, frame), np.full(n, k), box[mine], score[mine]]
            inputs.append(np.column_stack(columns))
            trackers[k].next = next_id
            ids, mean, last = trackers[k].update(box[mine].astype(float), score[mine].astype(float))
            next_id = trackers[k].next
            outputs.append(np.column_stack([np.full(len(ids), frame), ids, mean, last]))
    seen, tracks = np.concatenate(inputs), np.concatenate(outputs)
    np.savez_compressed(
        HERE / "published_reference.npz",
        frame=seen[:, 0].astype(np.int16),
        label=seen[:, 1].astype(np.int8),
        box=seen[:, 2:9].astype(np.float32),
        score=seen[:, 9].astype(np.float32),
        track_frame=tracks[:, 0].astype(np.int16),
        track_id=tracks[:, 1].astype(np.int32),
        track_state=tracks[:, 2:9],
        track_score=tracks[:, 9].astype(np.float32),
    )


if __name__ == "__main__":
    main()
