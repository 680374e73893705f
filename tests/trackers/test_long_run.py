"""A million filter steps: finite, symmetric and positive definite to the end."""

import numpy as np
import pytest

from mottrack.trackers import KalmanTracker
from mottrack.trackers.fixed_lag import FixedLagTracker
from mottrack.trackers.kalman.block_bank import BlockBank
from mottrack.trackers.kalman.observations import Matched, Observation, SeenBoxes
from tests.trackers.long_run import Health, hostile_drive

TRACKS, STEPS = 1000, 1000


@pytest.mark.parametrize("name", ["per axis", "coupled"])
def test_a_million_steps(name: str) -> None:
    rng = np.random.default_rng(1)
    bank = BlockBank(wiener=True)
    scale = 10.0 ** rng.uniform(-2, 3, (TRACKS, 1))
    process = scale**2 * np.tile(10.0 ** rng.uniform(-3, 0, 11), (TRACKS, 1))
    start = np.hstack([scale * rng.normal(size=(TRACKS, 7)), np.zeros((TRACKS, 4))])
    bank.append(start, np.tile(scale**2, (1, 11)), scale[:, :, None] ** 2 * np.eye(2))
    tilt = 0.4 * np.array([[0.0, 1.0], [1.0, 0.0]]) if name != "per axis" else 0.0
    for _ in range(STEPS):
        bank.predict(10.0 ** rng.uniform(-4, 1.5, TRACKS), process)
        rows = np.flatnonzero(rng.random(TRACKS) < 0.7)
        noise = (scale[rows] * 10.0 ** rng.uniform(-2, 0, (len(rows), 1))) ** 2
        residual = np.sqrt(noise) * rng.normal(size=(len(rows), 7))
        position = noise[:, :, None] * (np.eye(2) + tilt)
        box = bank.filters[0][rows, :7] + residual
        matched = Matched(rows, np.arange(len(rows)))
        bank.update_box(matched, SeenBoxes(box, position, np.tile(noise, (1, 5))))
        some = rows[rng.random(len(rows)) < 0.5]
        spread = scale[some, :, None] ** 2 * (np.eye(2) + tilt)
        error = scale[some] * rng.normal(size=(len(some), 2))
        velocity = Observation(bank.filters[0][some, 7:9] + error, spread)
        bank.update_velocity(some, velocity, rng.random(len(some)))
    covariance = bank.covariance(np.arange(TRACKS)) / scale[:, :, None] ** 2
    assert np.isfinite(bank.filters[0]).all()
    np.testing.assert_allclose(covariance, covariance.swapaxes(1, 2), atol=1e-9)
    assert np.linalg.eigvalsh(covariance).min() > 0


@pytest.mark.parametrize("make", [KalmanTracker, FixedLagTracker])
def test_gaps_scales_and_places_around_the_earth(make: type) -> None:
    """Of this, `benchmarks/long_runs.py` does hundreds of thousands of steps."""
    health, tracker = Health(), make()
    for objects in hostile_drive(np.random.default_rng(2), 600):
        health.add(tracker.step(objects.stamp_ns, objects))
    assert health.tracks > 100
    assert health.not_finite == 0
    assert health.asymmetry < 1e-9
    assert health.smallest > 0.0
