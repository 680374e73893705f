"""Measured velocities tested against the displacement of the track."""

from __future__ import annotations

import numpy as np
import pytest

from mottrack.core.velocity_errors import FLOW_ERRORS, NO_OUTLIERS
from mottrack.trackers.fixed_lag import FixedLagTracker
from mottrack.trackers.fixed_lag.config import MissedMotionConfig
from mottrack.trackers.fixed_lag.engine import History
from mottrack.trackers.fixed_lag.missed_motion import MissedMotionTest, displacement_velocity

from .conftest import MakeObjects

CAR = (4.0, 2.0)


def stamp(k: int) -> int:
    return (10 + k) * 10**8


def test_displacement_is_the_weighted_least_squares_line() -> None:
    rng = np.random.default_rng(0)
    age_s = np.array([[0.5, 0.31, 0.2, 0.0]])
    half = rng.normal(size=(1, 4, 2, 2))
    covariance = half @ half.transpose(0, 1, 3, 2) + 0.1 * np.eye(2)
    position = rng.normal(size=(1, 4, 2))
    there = np.array([[False, True, True, True]])
    mean, spread = displacement_velocity(there, age_s, position, covariance)
    rows, right = [], []
    for k in (1, 2, 3):
        root = np.linalg.cholesky(np.linalg.inv(covariance[0, k])).T
        rows.append(root @ np.hstack([np.eye(2), -age_s[0, k] * np.eye(2)]))
        right.append(root @ position[0, k])
    design, target = np.vstack(rows), np.concatenate(right)
    np.testing.assert_allclose(mean[0], np.linalg.lstsq(design, target)[0][2:], rtol=1e-9)
    expected = np.linalg.inv(design.T @ design)[2:, 2:]
    np.testing.assert_allclose(spread[0], expected, rtol=1e-9)


def test_one_node_says_nothing_of_the_velocity() -> None:
    there, age_s = np.array([[False, True]]), np.zeros((1, 2))
    covariance = np.tile(0.01 * np.eye(2), (1, 2, 1, 1))
    mean, spread = displacement_velocity(there, age_s, np.ones((1, 2, 2)), covariance)
    np.testing.assert_array_equal(mean, [[0, 0]])
    assert spread[0, 0, 0] >= 1e6


@pytest.mark.parametrize("speed_mps", [6.0, 9.0])
def test_a_flow_that_misses_a_motion_loses_its_weight(
    clusters: MakeObjects, speed_mps: float
) -> None:
    tracker = FixedLagTracker()
    for k in range(12):
        seen = clusters(stamp(k), [(0.1 * speed_mps * k, 0, *CAR)], [(0, 0)], FLOW_ERRORS)
        tracks = tracker.step(stamp(k), seen)
    assert tracks.id.tolist() == [1]
    assert abs(tracks.velocity_mps[0, 0] - speed_mps) < 0.5


def test_a_source_that_loses_no_motion_is_believed(clusters: MakeObjects) -> None:
    tracker = FixedLagTracker()
    for k in range(12):
        seen = clusters(stamp(k), [(0.6 * k, 0, *CAR)], [(0, 0)], NO_OUTLIERS)
        tracks = tracker.step(stamp(k), seen)
    assert len(tracks) == 1
    assert np.hypot(*tracks.velocity_mps[0]) < 0.5


def test_a_velocity_that_agrees_with_the_displacement_keeps_its_weight() -> None:
    age_s = np.arange(9, -1, -1)[None] * 0.1
    track = history(-6.0 * age_s[..., None] * [1, 0], age_s, velocity_mps=[6.0, 0.0])
    assert (MissedMotionTest(MissedMotionConfig()).odds(track, FLOW_ERRORS) < 0).all()
    track = history(-6.0 * age_s[..., None] * [1, 0], age_s, velocity_mps=[0.0, 0.0])
    assert (MissedMotionTest(MissedMotionConfig()).odds(track, FLOW_ERRORS) > 0).all()


def test_the_visible_part_of_a_wall_may_grow(clusters: MakeObjects) -> None:
    """A part that is uncovered at 12 m/s moves its middle at 6 m/s; the wall stands."""
    tracker = FixedLagTracker()
    for k in range(12):
        seen = clusters(stamp(k), [(0.6 * k, 0, 2 + 1.2 * k, 1)], [(0, 0)], FLOW_ERRORS)
        tracks = tracker.step(stamp(k), seen)
        if k > 0:
            assert np.hypot(*tracks.velocity_mps[0]) < 1.5


def test_a_cluster_that_jitters_is_not_set_in_motion(clusters: MakeObjects) -> None:
    rng, tracker = np.random.default_rng(1), FixedLagTracker()
    for k in range(30):
        at = 0.1 * rng.normal(size=2)  # as its covariance says
        seen = clusters(stamp(k), [(*at, *CAR)], [(0, 0)], FLOW_ERRORS)
        tracks = tracker.step(stamp(k), seen)
        if k > 0:
            assert np.hypot(*tracks.velocity_mps[0]) < 0.8


def history(position_m: np.ndarray, age_s: np.ndarray, velocity_mps: list[float]) -> History:
    """One track of an unchanging object, whose velocity was measured in every frame."""
    shape = age_s.shape
    return History(
        there=np.ones(shape, np.bool_),
        age_s=age_s,
        position_m=position_m,
        position_covariance_m2=np.tile(0.01 * np.eye(2), (*shape, 1, 1)),
        velocity_mps=np.tile(velocity_mps, (*shape, 1)),
        velocity_covariance_m2ps2=np.tile(0.3 * np.eye(2), (*shape, 1, 1)),
        has_velocity=np.ones(shape, np.bool_),
        extent_m=np.full(shape, 4.5),
    )
