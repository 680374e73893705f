"""The residual motion between two sweeps."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.core.pose import Pose
from mottrack.lidar.alignment import AlignmentConfig, AlignmentTarget, residual_motion


def corners(seed):
    """Walls in both directions, some posts, noise."""
    rng = np.random.default_rng(seed)
    along = rng.uniform(-30, 30, (4, 1200))
    walls = [
        np.column_stack([along[0], np.full(1200, 12.0)]),
        np.column_stack([along[1], np.full(1200, -9.0)]),
        np.column_stack([np.full(1200, 25.0), along[2]]),
        np.column_stack([np.full(1200, -20.0), along[3]]),
    ]
    xy = np.concatenate([*walls, rng.uniform(-20, 20, (60, 2)).repeat(10, axis=0)])
    z = rng.uniform(0.3, 2.5, (len(xy), 1))
    return (np.column_stack([xy, z]) + rng.normal(0, 0.01, (len(xy), 3))).astype(np.float32)


@settings(max_examples=10, deadline=None)
@given(
    x=st.floats(-0.15, 0.15),
    y=st.floats(-0.15, 0.15),
    turn=st.floats(-0.006, 0.006),
    seed=st.integers(0, 9),
)
def test_a_pose_error_is_corrected(x, y, turn, seed):
    current = corners(seed)
    error = Pose.from_yaw(turn, (x, y, 0.0))
    previous = error.apply(current).astype(np.float32)
    left = (residual_motion(previous, AlignmentTarget(current)) @ error).matrix - np.eye(4)
    assert np.abs(left[:2, 3]).max() < 0.02
    assert abs(left[1, 0]) < 1e-3


def test_a_large_correction_is_refused():
    current = corners(0)
    moved = current + np.array([0.28, 0.0, 0.0], np.float32)
    config = AlignmentConfig(max_shift_m=0.1)
    np.testing.assert_array_equal(
        residual_motion(moved, AlignmentTarget(current, config)).matrix, np.eye(4)
    )


def test_too_few_points_give_no_correction():
    few = np.ones((10, 3), np.float32)
    np.testing.assert_array_equal(
        residual_motion(few, AlignmentTarget(corners(0))).matrix, np.eye(4)
    )
