"""The Kalman tracker under a change of the unit of time, and with extreme input."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mottrack.core.errors import MottrackError
from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Objects, Tracks
from mottrack.core.pose import Pose
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.trackers import KalmanTracker
from mottrack.trackers.kalman.config import ClassNoise
from mottrack.trackers.kalman.noise_tables import TABLES

Workload = Callable[..., list[Objects]]


def with_velocities(stream: list[Objects], seed: int) -> list[Objects]:
    rng = np.random.default_rng(seed)
    moving = []
    for objects in stream:
        n = len(objects)
        spread = rng.normal(0, 1, (n, 2, 2))
        covariance = spread @ spread.swapaxes(1, 2) + 0.1 * np.eye(2)
        velocity = VelocityMeasurement(rng.normal(0, 2, (n, 2)), covariance, rng.random(n) < 0.6)
        moving.append(objects.with_velocity(velocity))
    return moving


def track(stream: list[Objects], config: KalmanTracker.Config | None = None) -> list[Tracks]:
    tracker = KalmanTracker(config)
    return [tracker.step(objects.stamp_ns, objects) for objects in stream]


def in_slow_motion(config: KalmanTracker.Config, factor: float) -> KalmanTracker.Config:
    """The settings of a world in which everything takes `factor` times as long."""
    power = np.array([1] * 7 + [3] * 4)
    classes = {}
    for label, noise in TABLES["default"].items():
        initial, process = np.array(noise.initial), np.array(noise.process)
        initial[7:] /= factor**2
        changed = noise.model_dump() | {"initial": initial, "process": process / factor**power}
        classes[label] = ClassNoise(**changed)
    management = config.track_management.model_copy(
        update={
            "max_coast_s": factor * config.track_management.max_coast_s,
            "output_coast_s": factor * config.track_management.output_coast_s,
            "decay_per_s": config.track_management.decay_per_s ** (1 / factor),
            "mean_life_s": factor * config.track_management.mean_life_s,
        }
    )
    test = config.velocity.test.model_copy(
        update={"memory_s": factor * config.velocity.test.memory_s}
    )
    velocity = config.velocity.model_copy(
        update={"floor_mps": config.velocity.floor_mps / factor, "test": test}
    )
    rates = ("start_per_s", "stop_per_s", "rest_mps")
    changed = {name: getattr(config.standing, name) / factor for name in rates}
    standing = config.standing.model_copy(update=changed)
    heading = config.heading.model_copy(
        update={
            "switch_per_s": config.heading.switch_per_s / factor,
            "correlation_s": factor * config.heading.correlation_s,
        }
    )
    noise = config.noise.model_copy(update={"classes": classes})
    return config.model_copy(
        update={
            "noise": noise,
            "track_management": management,
            "velocity": velocity,
            "standing": standing,
            "heading": heading,
        }
    )


@pytest.mark.parametrize("factor", [2, 10])
def test_slow_motion_changes_nothing_but_speeds(workload: Workload, factor: int) -> None:
    model = VelocityErrorModel(p_missed_slow=0.2, p_outlier=0.05)
    slower = replace(
        model,
        missed_speed_mps=model.missed_speed_mps / factor,
        outlier_sigma_mps=model.outlier_sigma_mps / factor,
    )
    stream, slow = [], []
    for o in with_velocities(workload(7, frames=20, crowd=40), 7):
        assert o.velocity is not None
        stream.append(o.with_velocity(o.velocity.with_error_model(model)))
        v = o.velocity
        v = VelocityMeasurement(
            v.mean_mps / factor, v.covariance_m2ps2 / factor**2, v.valid, slower
        )
        later = o.transformed(Pose.identity(), "world").with_velocity(v)
        slow.append(replace(later, stamp_ns=factor * o.stamp_ns))
    config = KalmanTracker.Config()
    tracker = KalmanTracker(in_slow_motion(config, factor))
    for a, o in zip(track(stream), slow, strict=True):
        b = tracker.step(o.stamp_ns, o)
        np.testing.assert_array_equal(a.id, b.id)
        np.testing.assert_allclose(a.centre_m, b.centre_m, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(a.velocity_mps, factor * b.velocity_mps, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(a.score, b.score, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"centre_m": np.full((1, 3), np.nan)}, "centre_m"),
        ({"size_m": np.array([[4.0, -2.0, 1.5]])}, "size_m"),
        ({"score": np.array([np.inf])}, "score"),
    ],
)
def test_unusable_boxes_never_reach_the_tracker(change: dict[str, object], words: str) -> None:
    good: dict[str, object] = {
        "stamp_ns": 0,
        "frame": "world",
        "centre_m": np.zeros((1, 3)),
        "size_m": np.ones((1, 3)),
        "yaw_rad": np.zeros(1),
        "label": np.array(["car"]),
        "score": np.ones(1),
    }
    with pytest.raises(MottrackError, match=words):
        Objects(**(good | change))  # type: ignore[arg-type]
    with pytest.raises(MottrackError, match="covariance"):
        VelocityMeasurement(np.zeros((1, 2)), -np.ones((1, 2, 2)), np.ones(1, bool))


def test_an_exact_velocity_is_no_division_by_zero() -> None:
    exact = VelocityMeasurement(np.full((1, 2), 3.0), np.zeros((1, 2, 2)), np.ones(1, bool))
    for preset in ("default", "pillarflow"):
        tracker = KalmanTracker(KalmanTracker.Config(preset=preset))
        for k in range(5):
            objects = Objects(
                stamp_ns=k * 10**8,
                frame="world",
                centre_m=np.full((1, 3), 0.3 * k),
                size_m=np.ones((1, 3)),
                yaw_rad=np.zeros(1),
                label=np.array(["car"]),
                score=np.ones(1),
                velocity=exact,
            )
            tracks = tracker.step(k * 10**8, objects)
        assert np.linalg.eigvalsh(tracks.covariance[0]).min() > 0
        np.testing.assert_allclose(tracks.velocity_mps, 3.0, atol=0.2)


def test_nothing_and_five_thousand_and_an_unknown_class() -> None:
    rng = np.random.default_rng(0)
    tracker = KalmanTracker()
    assert len(tracker.step(0, Objects.empty(0))) == 0
    n = 5000
    many = Objects(
        stamp_ns=1,
        frame="world",
        centre_m=np.column_stack([rng.uniform(-500, 500, (n, 2)), np.zeros(n)]),
        size_m=np.ones((n, 3)),
        yaw_rad=np.zeros(n),
        label=np.full(n, "hovercraft"),
        score=rng.random(n),
    )
    tracks = tracker.step(1, many)
    assert len(tracks) > 4900
    assert set(tracks.label.tolist()) == {"hovercraft"}
    again = tracker.step(10**8, replace(many, stamp_ns=10**8))
    assert set(again.id.tolist()) == set(tracks.id.tolist())
    published = KalmanTracker(KalmanTracker.Config(preset="stanford_iprl_tri"))
    assert len(published.step(1, many)) == 0
