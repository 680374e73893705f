"""The displacement of a track as the judge of its measured velocities."""

from __future__ import annotations

import numpy as np
import pytest

from mottrack.trackers.fixed_lag import FixedLagConfig, FixedLagTracker
from mottrack.trackers.fixed_lag.config import RobustConfig
from mottrack.trackers.fixed_lag.witness import displacement_velocity

from .conftest import MakeObjects

CAR = (4.0, 2.0)
JUDGED = FixedLagConfig(robust=RobustConfig(velocity_gate=3.0))


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
    judged, trusting = FixedLagTracker(JUDGED), FixedLagTracker()
    for k in range(12):
        seen = clusters(stamp(k), [(0.1 * speed_mps * k, 0, *CAR)], [(0, 0)])
        ours, theirs = judged.step(stamp(k), seen), trusting.step(stamp(k), seen)
    assert ours.id.tolist() == [1]
    assert abs(ours.velocity_mps[0, 0] - speed_mps) < 0.5
    lost = len(theirs) == 0 or theirs.id.tolist() != [1]
    assert lost or abs(theirs.velocity_mps[0, 0] - speed_mps) > 1.0


def test_a_cluster_that_jitters_is_not_set_in_motion(clusters: MakeObjects) -> None:
    rng, tracker = np.random.default_rng(1), FixedLagTracker(JUDGED)
    for k in range(30):
        at = 0.1 * rng.normal(size=2)  # as its covariance says
        tracks = tracker.step(stamp(k), clusters(stamp(k), [(*at, *CAR)], [(0, 0)]))
        if k > 0:
            assert np.hypot(*tracks.velocity_mps[0]) < 0.8
