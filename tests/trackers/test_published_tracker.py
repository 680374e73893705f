"""The stanford_iprl_tri preset against the structure-of-arrays prototype of the specification."""

import importlib.util
from collections import defaultdict
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from mottrack.core.objects import Objects
from mottrack.core.pose import wrap_angle
from mottrack.trackers import KalmanTracker
from mottrack.trackers.kalman.noise_table import published

CLASSES = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")
STEP_NS = 500_000_000


@pytest.fixture(scope="module")
def prototype(shared_data: Path) -> ModuleType:
    path = shared_data.parent / "prototypes" / "kalman_bank.py"
    if not path.exists():
        pytest.skip(f"needs the prototype {path.name}")
    spec = importlib.util.spec_from_file_location("kalman_bank", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def workload(seed: int, frames: int = 60, crowd: int = 60) -> list[Objects]:
    """Objects that drive, turn their boxes round, are missed, and fall silent by class."""
    rng = np.random.default_rng(seed)
    label = rng.choice(CLASSES, crowd)
    place = rng.uniform(-40, 40, (crowd, 2))
    speed = rng.normal(0, 2, (crowd, 2))
    yaw = rng.uniform(-np.pi, np.pi, crowd)
    stream = []
    for k in range(frames):
        seen = rng.random(crowd) < 0.8
        seen &= ~np.isin(label, rng.choice(CLASSES, 2)) | (rng.random() < 0.7)
        n = int(seen.sum())
        xy = place[seen] + speed[seen] * 0.5 * k + rng.normal(0, 0.3, (n, 2))
        heading = yaw[seen] + np.where(rng.random(n) < 0.2, np.pi, 0) + rng.normal(0, 0.3, n)
        stream.append(
            Objects(
                stamp_ns=k * STEP_NS,
                frame="world",
                centre_m=np.column_stack([xy, rng.normal(0, 0.2, n)]),
                size_m=np.abs(rng.normal([4, 2, 1.5], 0.2, (n, 3))),
                yaw_rad=wrap_angle(heading),
                label=label[seen],
                score=rng.random(n),
            )
        )
    return stream


def prototype_frames(module: ModuleType, stream: list[Objects]) -> list[dict[int, Any]]:
    """The prototype, one tracker a class, sharing one counter of ids as the original does."""
    noise = published()
    trackers = {
        c: module.T(noise[c].initial, noise[c].process, noise[c].observation) for c in CLASSES
    }
    next_id, frames = 0, []
    for objects in stream:
        out: dict[int, Any] = {}
        for c in CLASSES:
            mine = objects.select(objects.label == c)
            if len(mine) == 0:
                continue
            tracker = trackers[c]
            tracker.next = next_id
            z = np.column_stack([mine.centre_m, mine.yaw_rad, mine.size_m])
            ids, mean, score = tracker.update(z, mine.score)
            next_id = tracker.next
            out |= {int(i): (m, s) for i, m, s in zip(ids, mean, score, strict=True)}
        frames.append(out)
    return frames


@pytest.mark.parametrize("seed", range(4))
def test_same_ids_states_and_scores(prototype: ModuleType, seed: int) -> None:
    stream = workload(seed)
    tracker = KalmanTracker(KalmanTracker.Config(preset="stanford_iprl_tri"))
    seen: dict[int, int] = defaultdict(int)
    for objects, expected in zip(stream, prototype_frames(prototype, stream), strict=True):
        tracks = tracker.step(objects.stamp_ns, objects)
        assert sorted(tracks.id - 1) == sorted(expected)
        for row, identity in enumerate((tracks.id - 1).tolist()):
            mean, score = expected[identity]
            np.testing.assert_allclose(tracks.state[row, :7], mean, rtol=0, atol=1e-9)
            assert tracks.score[row] == score
            seen[identity] += 1
    assert sum(seen.values()) > 1000
