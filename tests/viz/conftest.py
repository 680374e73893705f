"""A stored scene of three key frames: a car seen as a box, a cluster seen as a hull, some flow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.pose import Pose
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.core.tables import FrameTable, TrackTable, TruthTable

FAR_M = np.array([4e5, 5e6, 30.0])
"""Where the vehicle starts: map coordinates are large."""
HULL_M = np.array([[8.0, 3.0], [10.0, 3.0], [9.0, 5.0]])
"""In the frame of the vehicle at the start."""


def boxes(kind, **more):
    """A car ahead in all three frames, 2 m further each time."""
    ahead = np.array([[10.0 + 2 * k, -3.0, 0.8] for k in range(3)])
    columns = {
        "frame": np.arange(3),
        "id": np.full(3, 7),
        "label": np.full(3, "car"),
        "centre_m": ahead + FAR_M,
        "size_m": np.tile([4.0, 2.0, 1.6], (3, 1)),
        "yaw_rad": np.zeros(3),
        "velocity_mps": np.tile([4.0, 0.0], (3, 1)),
    }
    return kind(**columns, **more)


@pytest.fixture
def result():
    still = Pose.from_yaw(0.0, FAR_M).matrix
    frames = FrameTable(
        np.array([0, 500_000_000, 1_000_000_000]),
        np.array(["a", "b", "c"]),
        np.stack([still] * 3),
        np.tile([-np.pi, np.pi], (3, 1)),
        np.ones(3, np.bool_),
    )
    tracks = boxes(
        TrackTable,
        velocity_covariance_m2ps2=np.tile(np.eye(2), (3, 1, 1)),
        score=np.ones(3),
        observed=np.ones(3, bool),
        hull_corners=np.array([0, 3, 0]),
    )
    truth = boxes(TruthTable, num_points=np.full(3, 9), interpolated=np.zeros(3, bool))
    return SceneResult("scene", frames, truth, tracks, hull_xy_m=HULL_M + FAR_M[:2])


@pytest.fixture
def snapshot():
    """Of the middle frame: a hundred points and one cell that moves to the right."""
    grid = BevGrid(-20.0, 20.0, -20.0, 20.0, 0.5)
    occupied = np.zeros(grid.shape, bool)
    occupied[60, 44] = True
    velocity_mps = np.zeros((*grid.shape, 2), np.float32)
    velocity_mps[60, 44] = 0.0, -6.0
    nothing = FlowField.empty(grid, 0)
    field = replace(nothing, occupied=occupied, valid=occupied, velocity_mps=velocity_mps)
    points = np.random.default_rng(0).uniform(-15, 15, (100, 3)).astype(np.float32)
    return Snapshot.of(1, points, field, None)
