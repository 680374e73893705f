"""How a source errs, recovered from samples of the law that the tracker assumes."""

import numpy as np
import pytest

from mottrack.core.errors import DataError, InputError
from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Objects
from mottrack.core.velocity_errors import VelocityErrorModel, read_error_models
from mottrack.flow.shipped_errors import FILE
from mottrack.trackers import KalmanTracker
from mottrack.trackers.noise_estimation.error_model import (
    VelocitySample,
    fit_error_model,
    persistence,
)

COUNT, STATED_MPS, FLOOR_MPS, SLOW_MPS = 6000, 0.4, 0.3, 2.0


def sample(missed: float, outlier: float, slow: float = 0.0) -> VelocitySample:
    """Velocities of objects at rest, at 3 to 12 m/s and at 1 to 3 m/s along an axis."""
    rng = np.random.default_rng(5)
    true = np.where(rng.random((COUNT, 1)) < 0.5, 0.0, rng.uniform(3.0, 12.0, (COUNT, 2)))
    true[::3] = np.column_stack([rng.uniform(1.0, 3.0, COUNT), np.zeros(COUNT)])[::3]
    sigma = np.hypot(STATED_MPS, FLOOR_MPS)
    measured = true + rng.normal(0.0, sigma, (COUNT, 2))
    draw = rng.random(COUNT)
    p_lost = missed + slow * np.exp(-0.5 * np.sum(true**2, axis=1) / SLOW_MPS**2)
    lost, wild = draw < p_lost, (draw >= p_lost) & (draw < p_lost + outlier)
    measured[lost] = rng.normal(0.0, sigma, (lost.sum(), 2))
    measured[wild] = rng.normal(0.0, np.hypot(5.0, sigma), (wild.sum(), 2))
    covariance = np.tile(STATED_MPS**2 * np.eye(2), (COUNT, 1, 1))
    return VelocitySample(np.full(COUNT, "car"), measured, covariance, true, np.arange(COUNT))


def test_recovers_the_probabilities() -> None:
    found = fit_error_model(sample(0.2, 0.1, slow=0.6))
    assert found.p_missed_motion == pytest.approx(0.2, abs=0.03)
    assert found.p_missed_slow == pytest.approx(0.6, abs=0.1)
    assert found.missed_speed_mps == pytest.approx(SLOW_MPS, abs=0.3)
    assert found.outlier_sigma_mps == pytest.approx(5.0, abs=0.7)
    assert found.p_outlier == pytest.approx(0.1, abs=0.02)
    assert found.relative < 0.05
    honest = sample(0.0, 0.0)
    assert honest.consistency == pytest.approx(1.0, abs=0.05)
    model = fit_error_model(honest)
    assert max(model.relative, model.p_missed_motion, model.p_outlier) < 0.02
    variance = dict(model.class_variances)
    assert variance["car"] == pytest.approx(STATED_MPS**2 + FLOOR_MPS**2, rel=0.05)


def test_recovers_the_persistence() -> None:
    """Errors of each object from a first-order autoregression of known correlation."""
    rng, objects, frames, correlation = np.random.default_rng(8), 400, 10, 0.6
    error = rng.normal(0.0, STATED_MPS, (objects, frames, 2))
    for k in range(1, frames):
        own = np.sqrt(1.0 - correlation**2) * error[:, k]
        error[:, k] = correlation * error[:, k - 1] + own
    true = np.repeat(rng.uniform(2.0, 9.0, (objects, 1, 2)), frames, axis=1)
    # as recorded: frame by frame, so the rows of an object lie apart
    rows = [part.swapaxes(0, 1).reshape(-1, 2) for part in (true + error, true)]
    covariance = np.tile(STATED_MPS**2 * np.eye(2), (objects * frames, 1, 1))
    object_ = np.tile(np.arange(objects), frames)
    moving = VelocitySample(np.full(len(object_), "car"), rows[0], covariance, rows[1], object_)
    assert persistence(moving) == pytest.approx(correlation, abs=0.03)
    model = VelocityErrorModel(persistence=correlation)
    # many of them tell as much as a quarter as many that are independent
    np.testing.assert_allclose(model.repeated(np.arange(3)), [1.0, 4.0, 4.0])


def test_movers_and_gross_errors_count_in_r_d() -> None:
    """Without the movers that were lost it would be 0.25."""
    assert dict(fit_error_model(sample(0.3, 0.0)).class_variances)["all"] > 5.0


def test_too_few_and_damaged(tmp_path) -> None:
    few = sample(0.0, 0.0)
    rows = VelocitySample(*(getattr(few, name)[:5] for name in VelocitySample.__slots__))
    with pytest.raises(InputError, match="measured velocities is 5, expected at least 20"):
        fit_error_model(rows)
    file = tmp_path / "errors.json"
    file.write_text('{"mine": {"relative": 0.1}}')
    with pytest.raises(DataError, match=r"errors\.json: content is"):
        read_error_models(file)


def test_every_shipped_source_is_calibrated() -> None:
    names = {"base", "base_raw", "small", "binary_ogm", "binary_ogm_raw", "dogma"}
    names |= {"icp", "icp_one_start", "cluster_icp"}
    assert names <= read_error_models(FILE).keys()


def test_the_preset_of_the_paper_is_plain() -> None:
    """Every measured velocity is believed as far as R_d of its class says, by the Kalman gain."""
    errors = VelocityErrorModel(
        relative=0.5, p_missed_motion=0.4, class_variances=(("car", 2.0), ("all", 4.0))
    )
    measured = VelocityMeasurement(
        np.array([[6.0, 0.0]]), 0.01 * np.eye(2)[None], np.ones(1, bool), errors
    )
    tracker = KalmanTracker(KalmanTracker.Config(preset="pillarflow"))
    for k in range(2):
        objects = Objects(
            stamp_ns=k * 5 * 10**8,
            frame="world",
            centre_m=np.zeros((1, 3)),
            size_m=np.array([[4.5, 1.9, 1.6]]),
            yaw_rad=np.zeros(1),
            label=np.array(["car"]),
            score=np.array([0.9]),
            velocity=measured if k == 0 else None,
        )
        tracks = tracker.step(objects.stamp_ns, objects)
        if k == 0:
            np.testing.assert_allclose(tracks.velocity_mps[0], [6.0, 0.0])
            np.testing.assert_allclose(tracks.velocity_covariance_m2ps2[0], 2.0 * np.eye(2))
