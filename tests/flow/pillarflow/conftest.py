"""Synthetic examples of moving boxes: enough for a network to learn, in milliseconds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mottrack.flow.pillarflow.engine import use_threads
from mottrack.flow.pillarflow.training.examples import Example
from mottrack.lidar.visibility import OCCUPIED

SIDE = 200
OLDER_AGES_S = (0.3, 0.5)


def _box_points(rng: np.random.Generator, centre: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Points (60,4) on the walls of an upright box."""
    along = rng.uniform(-0.5, 0.5, (60, 2))
    edge = rng.integers(0, 2, 60)
    along[np.arange(60), edge] = np.sign(along[np.arange(60), edge]) * 0.5
    height, reflectance = rng.uniform(0.3, 1.6, 60), rng.uniform(0, 1, 60)
    return np.column_stack((centre + along * size, height, reflectance)).astype(np.float32)


def _box_example(seed: int, boxes: int = 40, speed_mps: float = 12.0) -> Example:
    """Boxes of which every second one moves, seen at 10 Hz; visibility not known."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-45, 45, (boxes, 2)).astype(np.float32)
    size = rng.uniform(1.5, 4.5, (boxes, 2))
    motion = rng.uniform(-speed_mps, speed_mps, (boxes, 2)).astype(np.float32) * np.float32(0.1)
    motion[::2] = 0.0
    then = [_box_points(rng, c - m, s) for c, m, s in zip(centre, motion, size, strict=True)]
    now = [_box_points(rng, c, s) for c, s in zip(centre, size, strict=True)]
    ways = [motion * np.float32(age_s / 0.1) for age_s in OLDER_AGES_S]
    older = [
        _box_points(rng, c - m, s)
        for way in ways
        for c, m, s in zip(centre, way, size, strict=True)
    ]
    rows = np.repeat(np.arange(boxes, dtype=np.int16), 60)
    return Example(
        previous=np.concatenate(then),
        current=np.concatenate(now),
        previous_object=rows,
        current_object=rows,
        motion_m=motion[rows],
        centre_m=np.stack((centre - motion, centre, *(centre - m for m in ways)), axis=1),
        seen=np.zeros((4, SIDE, SIDE), np.uint8),
        elapsed_s=0.1,
        previous_sight=np.full(len(rows), OCCUPIED, np.int8),
        current_sight=np.full(len(rows), OCCUPIED, np.int8),
        older=np.concatenate(older),
        older_object=np.tile(rows, 2),
        older_slot=np.repeat(np.arange(2, dtype=np.uint8), len(rows)),
        older_age_s=np.array(OLDER_AGES_S),
    )


@pytest.fixture
def box_example() -> Callable[..., Example]:
    """Return a function that makes an example from a seed."""
    return _box_example


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    use_threads(1)
