"""Random but plausible streams of detections, for every test of a tracker on boxes."""

from collections.abc import Callable

import numpy as np
import pytest

from mottrack.core.objects import Objects
from mottrack.core.pose import wrap_angle

CLASSES = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")
STEP_NS = 500_000_000

Workload = Callable[..., list[Objects]]


@pytest.fixture(scope="session")
def workload() -> Workload:
    """Makes a stream: workload(seed, frames=60, crowd=60)."""
    return make_workload


def make_workload(seed: int, frames: int = 60, crowd: int = 60) -> list[Objects]:
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
