"""Sources of velocities that are honest, and sources that are not, beside known motions."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
import pytest

from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Objects
from mottrack.trackers import KalmanTracker
from mottrack.trackers.kalman.noise_tables import TABLES

STEP_NS, STEPS, OBJECTS, STATED_MPS = 10**8, 40, 30, 0.3
FLOOR_MPS = KalmanTracker.Config().velocity.floor_mps


@dataclass(frozen=True)
class Source:
    """How measured velocities come from true ones; all state a deviation of `STATED_MPS`."""

    sigma_mps: float = STATED_MPS
    missed: float = 0.0
    gain: float = 1.0


SOURCES = {
    "honest": Source(),
    "noisy": Source(sigma_mps=4.0),
    "misses motions": Source(missed=0.8),
    "reads half of the speed": Source(gain=0.5),
}


@dataclass(frozen=True)
class Drive:
    """Cars on a wide grid, a third of them parked, that move by the law of the tracker's table."""

    frames: list[Objects]
    velocity_mps: np.ndarray
    """(frames, cars, 2)"""


def drive(source: Source | None) -> Drive:
    """Return the same drive with measured velocities of a source; None: without flow."""
    rng, noise = np.random.default_rng(11), TABLES["default"]["car"]
    moves = np.arange(OBJECTS) % 3 > 0
    velocity = np.column_stack([moves * rng.uniform(3.0, 12.0, OBJECTS), np.zeros(OBJECTS)])
    place = np.column_stack([np.zeros(OBJECTS), 30.0 * np.arange(OBJECTS)])
    frames, true = [], []
    for k in range(STEPS):
        turn = rng.normal(0.0, np.sqrt(0.1 * np.array(noise.process[7:9])), (OBJECTS, 2))
        velocity = velocity + moves[:, None] * turn
        place = place + 0.1 * velocity
        seen = place + rng.normal(0.0, np.sqrt(noise.observation[:2]), (OBJECTS, 2))
        error, lost = rng.normal(size=(OBJECTS, 2)), rng.random(OBJECTS)
        objects = Objects(
            stamp_ns=k * STEP_NS,
            frame="world",
            centre_m=np.column_stack([seen, np.zeros(OBJECTS)]),
            size_m=np.tile([4.5, 1.9, 1.6], (OBJECTS, 1)),
            yaw_rad=np.zeros(OBJECTS),
            label=np.full(OBJECTS, "car"),
            score=np.full(OBJECTS, 0.9),
        )
        if source is not None:
            mean = np.where(lost[:, None] < source.missed, 0.0, source.gain * velocity)
            measured = VelocityMeasurement(
                mean + source.sigma_mps * error,
                np.tile(STATED_MPS**2 * np.eye(2), (OBJECTS, 1, 1)),
                np.ones(OBJECTS, np.bool_),
            )
            objects = objects.with_velocity(measured)
        frames.append(objects)
        true.append(velocity)
    return Drive(frames, np.array(true))


def believing() -> KalmanTracker:
    return KalmanTracker(KalmanTracker.Config(velocity={"test": {"use": False}}))


def errors(tracker: KalmanTracker, driven: Drive) -> np.ndarray:
    """Return (K,) velocity errors of all tracks of all frames."""
    found = []
    for objects, true in zip(driven.frames, driven.velocity_mps, strict=True):
        tracks = tracker.step(objects.stamp_ns, objects)
        row = np.rint(tracks.centre_m[:, 1] / 30.0).astype(int)
        found.append(np.hypot(*(tracks.velocity_mps - true[row]).T))
    return np.concatenate(found)


def test_an_honest_source_is_believed_from_the_start() -> None:
    frames = drive(SOURCES["honest"]).frames
    plain, tested = believing(), KalmanTracker()
    for objects in frames:
        a, b = (one.step(objects.stamp_ns, objects) for one in (plain, tested))
        np.testing.assert_allclose(b.velocity_mps, a.velocity_mps, rtol=0.02, atol=0.05)
        # the gain: no wider a covariance than the one that the measurement states
        spread = [np.trace(t.velocity_covariance_m2ps2, axis1=1, axis2=2).mean() for t in (b, a)]
        assert spread[0] < 1.1 * spread[1]
    assert tested.velocity_concern() is None


@pytest.mark.parametrize("name", [name for name in SOURCES if name != "honest"])
def test_a_dishonest_source_is_weighed_down(name: str) -> None:
    driven, tracker = drive(SOURCES[name]), KalmanTracker()
    with_test, without_flow = errors(tracker, driven), errors(KalmanTracker(), drive(None))
    assert with_test.mean() < 0.5 * errors(believing(), driven).mean()
    last = len(with_test) // 4  # of the last ten frames: what was learned is not forgotten
    assert with_test[-last:].mean() < without_flow[-last:].mean() + 0.1
    concern = tracker.velocity_concern()
    assert concern is not None
    assert concern.count > 1000
    assert "of what they state" in str(concern)


def test_shares_scales_and_gains_are_found() -> None:
    """On what the positions of the tracks alone tell of the source."""
    stated = STATED_MPS**2 + FLOOR_MPS**2
    for source in (Source(missed=0.5), Source(sigma_mps=1.2), Source(gain=0.6)):
        tracker = KalmanTracker()
        errors(tracker, drive(source))
        law = tracker.law
        assert law.failures.p_missed == pytest.approx(source.missed, abs=0.1)
        assert law.gain == pytest.approx(source.gain, abs=0.1)
        expected = max(source.sigma_mps**2 / stated, 1.0)
        assert law.scale == pytest.approx(expected, rel=0.5)


def test_a_copy_continues_as_the_original() -> None:
    """The estimate is part of the tracker's state, and the same for the same input."""
    frames = drive(SOURCES["noisy"]).frames
    tracker = KalmanTracker()
    for objects in frames[:20]:
        tracker.step(objects.stamp_ns, objects)
    copied = copy.deepcopy(tracker)
    for objects in frames[20:]:
        a, b = (one.step(objects.stamp_ns, objects) for one in (tracker, copied))
        np.testing.assert_array_equal(a.velocity_mps, b.velocity_mps)
    assert tracker.velocity_concern() == copied.velocity_concern()


def test_velocities_along_a_beam_do_not_lower_the_scale() -> None:
    """What was not measured across the beam of a radar says nothing about its errors."""
    driven, beams = drive(None), np.tile([1.0, 0.0], (OBJECTS, 1))
    tracker, rng = KalmanTracker(), np.random.default_rng(3)
    for objects, true in zip(driven.frames, driven.velocity_mps, strict=True):
        speed = true[:, 0] + rng.normal(0.0, 1.2, OBJECTS)
        radial = VelocityMeasurement.along(beams, speed, np.full(OBJECTS, STATED_MPS**2))
        tracker.step(objects.stamp_ns, objects.with_velocity(radial))
    assert tracker.law.scale > 3.0
