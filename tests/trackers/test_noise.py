"""The estimated noise is the noise that was put in, gross errors or not."""

import numpy as np
import pytest

from mottrack.core.errors import InputError
from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Objects, Truth
from mottrack.trackers import KalmanTracker
from mottrack.trackers.noise_estimation.consistency import consistency, nees
from mottrack.trackers.noise_estimation.estimate import estimate_noise, estimate_velocity_noise
from mottrack.trackers.noise_estimation.samples import SampleCollector

STEP_S = 0.5
SIGMA = np.array([0.4, 0.2, 0.1, 0.08, 0.2, 0.1, 0.15])
PUSH = 1.5
CARS = 60


@pytest.fixture(scope="module")
def frames() -> list[tuple[Objects, Truth]]:
    """Cars under white acceleration along their heading, some boxes reversed, a few far off."""
    rng = np.random.default_rng(0)
    yaw = rng.uniform(-np.pi, np.pi, CARS)
    heading = np.column_stack([np.cos(yaw), np.sin(yaw)])
    side = np.column_stack([-np.sin(yaw), np.cos(yaw)])
    place = 60.0 * np.column_stack([np.arange(CARS) % 8, np.arange(CARS) // 8])
    speed, travelled = rng.normal(0, 4, CARS), np.zeros(CARS)
    out = []
    for k in range(60):
        shake = rng.multivariate_normal(
            [0, 0],
            PUSH * np.array([[STEP_S**3 / 3, STEP_S**2 / 2], [STEP_S**2 / 2, STEP_S]]),
            CARS,
        )
        travelled, speed = travelled + speed * STEP_S + shake[:, 0], speed + shake[:, 1]
        truth = make_truth(k, place + travelled[:, None] * heading, yaw, speed[:, None] * heading)
        error = SIGMA * rng.normal(size=(CARS, 7))
        error[:, 3] += np.where(rng.random(CARS) < 0.2, np.pi, 0.0)
        error[:, 2] += np.where(rng.random(CARS) < 0.02, 5.0, 0.0)
        out.append((detect(truth, error, (heading, side), rng), truth))
    return out


def make_truth(k: int, xy: np.ndarray, yaw: np.ndarray, velocity: np.ndarray) -> Truth:
    return Truth(
        stamp_ns=int(k * STEP_S * 1e9),
        frame="world",
        centre_m=np.column_stack([xy, np.zeros(CARS)]),
        size_m=np.tile([4.5, 1.9, 1.6], (CARS, 1)),
        yaw_rad=yaw,
        label=np.full(CARS, "car"),
        id=np.arange(CARS),
        velocity_mps=velocity,
        num_points=np.full(CARS, 50),
        interpolated=np.zeros(CARS, bool),
    )


def detect(
    truth: Truth,
    error: np.ndarray,
    axes: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
) -> Objects:
    offset = error[:, :1] * axes[0] + error[:, 1:2] * axes[1]
    velocity = VelocityMeasurement(
        truth.velocity_mps + rng.normal(0, 0.7, (CARS, 2)),
        np.tile(np.eye(2), (CARS, 1, 1)),
        rng.random(CARS) < 0.5,
    )
    return Objects(
        stamp_ns=truth.stamp_ns,
        frame="world",
        centre_m=truth.centre_m + np.column_stack([offset, error[:, 2]]),
        size_m=truth.size_m + error[:, 4:],
        yaw_rad=truth.yaw_rad + error[:, 3],
        label=truth.label,
        score=np.full(CARS, 0.8),
        velocity=velocity,
    )


def test_recovers_the_noise(frames: list[tuple[Objects, Truth]]) -> None:
    collector = SampleCollector()
    for objects, truth in frames:
        collector.add("scene", objects, truth)
    found = estimate_noise(collector.samples())["car"]
    sigma = np.sqrt(found.noise.observation)
    np.testing.assert_allclose(sigma[1:], SIGMA[1:], rtol=0.06)
    assert found.noise.longitudinal_ratio == pytest.approx(2.0, rel=0.1)
    # half of the acceleration lies along either axis of the plane, on average
    assert found.noise.process[7] == pytest.approx(PUSH / 2, rel=0.1)
    assert found.noise.lateral_ratio < 0.1
    assert found.outliers > 0
    velocity = estimate_velocity_noise(collector.samples())
    assert velocity is not None
    # the gross errors of the made-up source are among them
    assert velocity.variance_m2ps2 > 0.49
    assert velocity.class_variance_m2ps2["car"] == velocity.variance_m2ps2


def test_the_estimate_makes_an_honest_filter(frames: list[tuple[Objects, Truth]]) -> None:
    collector = SampleCollector()
    for objects, truth in frames[:30]:
        collector.add("scene", objects, truth)
    noise = {"classes": {"car": estimate_noise(collector.samples())["car"].noise}}
    tracker = KalmanTracker(KalmanTracker.Config(noise=noise, diagnose=True))
    errors, surprises = [], []
    for objects, truth in frames:
        tracks = tracker.step(objects.stamp_ns, objects.with_velocity(None))
        assert tracker.innovations is not None
        surprises.append(tracker.innovations.box)
        errors.append(nees(tracks, truth).squared)
    # past the first steps and without the gross errors, which no honest filter expects
    surprise, error = np.concatenate(surprises[5:]), np.concatenate(errors[5:])
    assert 0.7 < consistency(surprise[surprise < 50], 7).mean_ratio < 1.2
    assert 0.6 < consistency(error[error < 50], 4).mean_ratio < 1.3
    assert consistency(surprise, 7).inside_95 > 0.85


def test_too_little_to_learn_from() -> None:
    collector = SampleCollector()
    collector.add("scene", Objects.empty(0), Truth.empty(0))
    with pytest.raises(InputError, match="pairs by class"):
        estimate_noise(collector.samples())
