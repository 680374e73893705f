"""The stanford_iprl_tri preset against the structure-of-arrays prototype of the specification."""

import importlib.util
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from mottrack.core.objects import Objects
from mottrack.trackers import KalmanTracker
from mottrack.trackers.kalman.noise_table import published

CLASSES = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")


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
def test_same_ids_states_and_scores(
    prototype: ModuleType, workload: Callable[..., list[Objects]], seed: int
) -> None:
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
