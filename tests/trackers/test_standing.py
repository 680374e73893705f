"""The hypotheses that a track stands or moves, against joint densities and known motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.special import expit, logit
from scipy.stats import multivariate_normal

from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Objects, Tracks
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.trackers import KalmanTracker
from mottrack.trackers.kalman.noise_tables import TABLES

STEP_NS = 10**8
MISSES_SLOW = VelocityErrorModel(p_missed_motion=0.1, p_missed_slow=0.7, missed_speed_mps=2.0)


def seen(k: int, x_m: float, velocity: VelocityMeasurement | None = None) -> Objects:
    return Objects(
        stamp_ns=k * STEP_NS,
        frame="world",
        centre_m=np.array([[x_m, 0.0, 0.0]]),
        size_m=np.array([[4.5, 1.9, 1.6]]),
        yaw_rad=np.zeros(1),
        label=np.array(["car"]),
        score=np.array([0.9]),
        velocity=velocity,
    )


def at_rest(sigma_mps: float) -> VelocityMeasurement:
    covariance = sigma_mps**2 * np.eye(2)[None]
    return VelocityMeasurement(np.zeros((1, 2)), covariance, np.ones(1, bool), MISSES_SLOW)


def followed(tracker: KalmanTracker, steps: list[Objects]) -> list[Tracks]:
    return [tracker.step(objects.stamp_ns, objects) for objects in steps]


def test_probability_is_that_of_the_joint_densities() -> None:
    """Without changes of the hypothesis; the moving density is filterpy's."""
    config = KalmanTracker.Config(standing={"start_per_s": 0.0, "stop_per_s": 0.0})
    tracker = KalmanTracker(config)
    x = np.array([0.0, 0.35, -0.1, 0.2, 0.5])
    tracks = followed(tracker, [seen(k, value) for k, value in enumerate(x)])
    noise, dt = TABLES["default"]["car"], STEP_NS * 1e-9
    r = noise.observation[0]
    # along y nothing is off, but both hypotheses give it a density: the same model twice
    log_moves = 0.0
    for axis, values, ratio in ((0, x, 1.0), (1, 0.0 * x, noise.lateral_ratio)):
        one = KalmanFilter(dim_x=2, dim_z=1)
        one.F, one.H = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[1.0, 0.0]])
        p, q = noise.process[axis], noise.process[7 + axis]
        one.Q = np.array([[p * dt + q * dt**3 / 3, q * dt**2 / 2], [q * dt**2 / 2, q * dt]])
        one.R *= r
        one.x, one.P = np.zeros((2, 1)), np.diag([r, ratio**2 * noise.initial[7]])
        for value in values[1:]:
            one.predict()
            one.update(value)
            log_moves += one.log_likelihood
    # the place is known from the first detection alone: all others share its error
    joint = multivariate_normal(np.zeros(4), r * (np.eye(4) + np.ones((4, 4))))
    log_stands = joint.logpdf(x[1:]) + joint.logpdf(np.zeros(4))
    p_standing = expit(logit(config.standing.prior["car"]) + log_stands - log_moves)
    assert tracks[-1].state is not None
    speed, expected = tracks[-1].velocity_mps[0, 0], (1 - p_standing) * tracks[-1].state[0, 7]
    assert 0.02 < p_standing < 0.99
    assert speed == pytest.approx(expected, rel=1e-9)


def test_a_parked_car_stands_and_a_creeping_one_creeps() -> None:
    """Flow reads zero of both; the way that they have come tells them apart."""
    rng = np.random.default_rng(4)
    noise_m = rng.normal(0.0, 0.1, 40)
    for speed_mps, bounds in ((0.0, (0.0, 0.05)), (1.5, (1.2, 1.8))):
        x = speed_mps * 0.1 * np.arange(40) + noise_m
        steps = [seen(k, value, at_rest(0.2)) for k, value in enumerate(x)]
        last = followed(KalmanTracker(), steps)[-10:]
        found = np.mean([np.hypot(*t.velocity_mps[0]) for t in last])
        assert bounds[0] <= found <= bounds[1], speed_mps


def test_switched_off_it_is_the_plain_filter() -> None:
    config = KalmanTracker.Config(standing={"use": False})
    tracks = followed(KalmanTracker(config), [seen(k, 0.01 * k) for k in range(5)])
    assert tracks[-1].state is not None
    np.testing.assert_array_equal(tracks[-1].velocity_mps, tracks[-1].state[:, 7:9])


def test_a_mover_does_not_take_a_parked_car() -> None:
    """It was seen to move, so what stands where it is expected is likelier another object."""
    calibrated = VelocityErrorModel(p_missed_motion=0.01)
    moving = replace(at_rest(0.3), mean_mps=np.array([[8.0, 0.0]]), error_model=calibrated)
    way = [seen(5 * k, 4.0 * k, moving) for k in range(6)]
    beside = replace(seen(30, 22.5), velocity=replace(at_rest(0.2), error_model=calibrated))
    taken = {}
    for share in (0.0, KalmanTracker.Config().association.new_at_rest):
        tracker = KalmanTracker(KalmanTracker.Config(association={"new_at_rest": share}))
        before = followed(tracker, way)[-1]
        after = tracker.step(beside.stamp_ns, beside)
        new = after.id[after.observed] != before.id
        taken[share] = not new.any()
        if new.any():
            np.testing.assert_allclose(after.velocity_mps[after.observed], 0.0, atol=0.1)
    assert list(taken.values()) == [True, False]
