"""Smoothing against filterpy's Rauch-Tung-Striebel smoother, and against the truth."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from mottrack.core.errors import ConfigError
from mottrack.core.objects import Objects, Tracks
from mottrack.trackers import KalmanTracker
from mottrack.trackers.kalman.noise import NoiseTable, process_covariance
from mottrack.trackers.kalman.smoothing import smooth

STEP_NS = 100_000_000
SPEED_MPS = 8.0


def car(k: int, rng: np.random.Generator) -> Objects:
    noise = rng.normal(0, 0.3, 3)
    return Objects(
        stamp_ns=k * STEP_NS,
        frame="world",
        centre_m=np.array([[SPEED_MPS * 0.1 * k, 0.0, 0.0]]) + noise,
        size_m=np.array([[4.5, 1.9, 1.6]]),
        yaw_rad=rng.normal(0, 0.1, 1),
        label=np.array(["car"]),
        score=np.array([0.9]),
    )


@pytest.fixture(scope="module")
def steps() -> list[Tracks]:
    """One car, unseen from step 20 to step 29."""
    rng = np.random.default_rng(0)
    tracker = KalmanTracker()
    out = []
    for k in range(50):
        seen = Objects.empty(k * STEP_NS) if 20 <= k < 30 else car(k, rng)
        out.append(tracker.step(k * STEP_NS, seen))
    return out


def test_equals_filterpy(steps: list[Tracks]) -> None:
    smoothed = smooth(steps)
    rows = [s for s in steps if len(s)]
    table = NoiseTable(KalmanTracker().config.noise)
    process = table.rows(table.index(np.array(["car"]))).process
    stamps = np.array([s.stamp_ns for s in rows]) * 1e-9
    transitions, growths = [np.eye(11)], [np.eye(11)]
    for dt in np.diff(stamps):
        step = np.eye(11)
        step[:4, 7:] = dt * np.eye(4)
        transitions.append(step)
        growths.append(process_covariance(process, np.array([dt]), True)[0])
    reference = KalmanFilter(dim_x=11, dim_z=7)
    expected, spread, _, _ = reference.rts_smoother(
        np.array([s.state[0] for s in rows]),
        np.array([s.covariance[0] for s in rows]),
        transitions,
        growths,
    )
    by_stamp = {s.stamp_ns: s for s in smoothed}
    for k, row in enumerate(rows):
        np.testing.assert_allclose(by_stamp[row.stamp_ns].state[0], expected[k], atol=1e-8)
        np.testing.assert_allclose(by_stamp[row.stamp_ns].covariance[0], spread[k], atol=1e-8)


def test_fills_gaps_and_comes_nearer_to_the_truth(steps: list[Tracks]) -> None:
    smoothed = KalmanTracker(KalmanTracker.Config(smooth=True)).finish(steps)
    assert KalmanTracker().finish(steps) is steps
    assert [len(s) for s in smoothed] == [1] * 50
    assert not smoothed[25].observed[0]
    assert smoothed[10].observed[0]
    truth = SPEED_MPS * 0.1 * np.arange(50)
    error = np.array([s.centre_m[0, 0] for s in smoothed]) - truth
    filtered = np.array([s.centre_m[0, 0] - t for s, t in zip(steps, truth, strict=True) if len(s)])
    assert np.abs(error).mean() < 0.8 * np.abs(filtered).mean()
    assert abs(smoothed[0].velocity_mps[0, 0] - SPEED_MPS) < 1.0
    assert steps[0].velocity_mps[0, 0] == 0.0


def test_refuses_what_it_cannot_retrace(steps: list[Tracks]) -> None:
    with pytest.raises(ConfigError, match="seconds"):
        smooth(steps, KalmanTracker.Config(preset="stanford_iprl_tri"))
