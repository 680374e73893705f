"""Motion models against their own derivatives, the circle, and each other."""

import numpy as np
import pytest

from mottrack.core.objects import Objects
from mottrack.trackers import KalmanTracker
from mottrack.trackers.kalman.imm_bank import ImmBank
from mottrack.trackers.kalman.motion_models import MOTION_MODELS, REAR_AXLE

CA_OF_11 = ("ca", 11)
"""Constant acceleration needs the acceleration in its state."""


def states(n: int, size: int) -> np.ndarray:
    rng = np.random.default_rng(n)
    state = rng.normal(0, 2, (n, size))
    state[:, 4:7] = rng.uniform(2, 5, (n, 3))
    state[:, 10] = rng.normal(0, 0.3, n)
    yaw = rng.uniform(-3, 3, n)
    state[:, 3] = yaw
    speed, slip = rng.uniform(3, 12, n), rng.normal(0, 0.05, n)
    state[:, 7], state[:, 8] = speed * np.cos(yaw + slip), speed * np.sin(yaw + slip)
    state[: n // 4, 10] *= 1e-6
    return state


@pytest.mark.parametrize(
    ("name", "size"),
    [(n, s) for n in sorted(MOTION_MODELS) for s in (11, 13) if (n, s) != CA_OF_11],
)
def test_jacobians_are_the_derivatives(name: str, size: int) -> None:
    model, state = MOTION_MODELS[name], states(16, size)
    dt = np.random.default_rng(0).uniform(0.05, 0.8, 16)
    _, jacobian = model(state, dt)
    step = 1e-6
    for k in range(size):
        nudge = np.zeros(size)
        nudge[k] = step
        slope = (model(state + nudge, dt)[0] - model(state - nudge, dt)[0]) / (2 * step)
        np.testing.assert_allclose(jacobian[:, :, k], slope, atol=2e-5)


def test_a_constant_turn_stays_on_its_circle() -> None:
    state = np.zeros((1, 11))
    state[0, 7], state[0, 10] = 10.0, 0.5
    for _ in range(8):
        state, _ = MOTION_MODELS["ctrv"](state, np.array([0.4]))
    angle = 0.5 * 3.2
    np.testing.assert_allclose(state[0, :2], [20 * np.sin(angle), 20 * (1 - np.cos(angle))])
    np.testing.assert_allclose(state[0, 7:9], [10 * np.cos(angle), 10 * np.sin(angle)])


def test_a_bicycle_turns_as_its_rear_axle_allows() -> None:
    state = np.zeros((2, 11))
    state[:, 4] = 4.5
    rate = 0.4
    state[:, 7], state[:, 8] = 8.0, REAR_AXLE * 4.5 * rate
    state[1, 3] = np.pi  # the same car, its box the wrong way round
    after, _ = MOTION_MODELS["bicycle"](state, np.full(2, 0.1))
    np.testing.assert_allclose(after[:, 10], rate)
    np.testing.assert_allclose(after[0, :2], after[1, :2])


def roundabout(k: int, rng: np.random.Generator) -> Objects:
    """A car that drives straight for two seconds and then turns at half a radian a second."""
    t = 0.1 * k
    angle = 0.5 * max(t - 2.0, 0.0)
    x = 10 * min(t, 2.0) + 20 * np.sin(angle)
    y = 20 * (1 - np.cos(angle))
    return Objects(
        stamp_ns=k * 10**8,
        frame="world",
        centre_m=np.array([[x, y, 0.0]]) + rng.normal(0, 0.1, 3),
        size_m=np.array([[4.5, 1.9, 1.6]]),
        yaw_rad=np.array([angle]) + rng.normal(0, 0.05, 1),
        label=np.array(["car"]),
        score=np.array([0.9]),
    )


@pytest.mark.parametrize("motion", ["cv", "ca", "ctrv", "bicycle", "imm"])
def test_every_model_follows_a_turn(motion: str) -> None:
    rng = np.random.default_rng(1)
    tracker = KalmanTracker(KalmanTracker.Config(motion={"classes": {"car": motion}}))
    for k in range(60):
        tracks = tracker.step(k * 10**8, roundabout(k, rng))
    assert tracks.id.tolist() == [1]
    speed = np.linalg.norm(tracks.velocity_mps[0])
    assert speed == pytest.approx(10.0, abs=1.5)
    assert np.linalg.eigvalsh(tracks.covariance[0]).min() > 0


def test_the_mixture_finds_the_turn() -> None:
    rng = np.random.default_rng(2)
    config = KalmanTracker.Config(motion={"default": "imm", "imm": ["cv", "ctrv"]})
    tracker = KalmanTracker(config)
    chance = []
    for k in range(60):
        tracker.step(k * 10**8, roundabout(k, rng))
        bank = tracker._bank
        assert isinstance(bank, ImmBank)
        chance.append(bank.probability[0, config.motion.models().index("ctrv")])
    assert np.mean(chance[40:]) > 0.9 > np.mean(chance[10:20])


def test_motion_is_chosen_by_class() -> None:
    motion = {"default": "cv", "classes": {"car": "imm", "bus": "ca"}}
    tracker = KalmanTracker(KalmanTracker.Config(motion=motion))
    for k in range(5):
        one = roundabout(k, np.random.default_rng(3))
        labels = np.array(["car", "bus", "trailer"])
        three = Objects(
            stamp_ns=one.stamp_ns,
            frame="world",
            centre_m=one.centre_m + np.array([[0, 0, 0], [0, 30, 0], [0, 60, 0]]),
            size_m=np.tile(one.size_m, (3, 1)),
            yaw_rad=np.tile(one.yaw_rad, 3),
            label=labels,
            score=np.ones(3),
        )
        tracks = tracker.step(three.stamp_ns, three)
    assert sorted(tracks.label.tolist()) == sorted(labels.tolist())
    assert tracks.state.shape == (3, 13)
    bank = tracker._bank
    assert isinstance(bank, ImmBank)
    assert ((bank.probability > 0).sum(axis=1) == np.array([1, 3, 1])).all()
