"""Sources of velocities that state too small a covariance, or miss motions, beside known ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Objects
from mottrack.trackers.fixed_lag.tracker import FixedLagTracker

STEP_NS, STEPS, OBJECTS = 10**8, 30, 24


@dataclass(frozen=True)
class Source:
    """Half of the objects stand; errors are `sigma_mps` while `stated_mps` is stated."""

    sigma_mps: float
    stated_mps: float
    missed: float = 0.0


def errors(source: Source | None, *, tested: bool = True) -> tuple[np.ndarray, FixedLagTracker]:
    """Return (frames, objects) velocity errors, NaN where there is no track."""
    rng = np.random.default_rng(5)
    moves = np.arange(OBJECTS) % 2 == 0
    velocity = np.column_stack([moves * rng.uniform(4.0, 12.0, OBJECTS), np.zeros(OBJECTS)])
    tracker = FixedLagTracker(FixedLagTracker.Config(velocity_test={"use": tested}))
    found = np.full((STEPS, OBJECTS), np.nan)
    for k in range(STEPS):
        place = 0.1 * k * velocity + np.column_stack([np.zeros(OBJECTS), 30.0 * np.arange(OBJECTS)])
        seen = place + rng.normal(0.0, 0.1, (OBJECTS, 2))
        error = rng.normal(size=(OBJECTS, 2))
        objects = Objects(
            stamp_ns=k * STEP_NS,
            frame="world",
            centre_m=np.column_stack([seen, np.zeros(OBJECTS)]),
            size_m=np.tile([4.5, 1.9, 1.6], (OBJECTS, 1)),
            yaw_rad=np.zeros(OBJECTS),
            label=np.full(OBJECTS, "cluster"),
            score=np.ones(OBJECTS),
        )
        if source is not None:
            missed = rng.random(OBJECTS) < source.missed
            measured = VelocityMeasurement(
                np.where(missed[:, None], 0.0, velocity) + source.sigma_mps * error,
                np.tile(source.stated_mps**2 * np.eye(2), (OBJECTS, 1, 1)),
                np.ones(OBJECTS, np.bool_),
            )
            objects = objects.with_velocity(measured)
        tracks = tracker.step(objects.stamp_ns, objects)
        row = np.rint(tracks.centre_m[:, 1] / 30.0).astype(int)
        found[k, row] = np.hypot(*(tracks.velocity_mps - velocity[row]).T)
    return found, tracker


def test_a_covariance_ten_times_too_small_is_found_out() -> None:
    source = Source(sigma_mps=3.2, stated_mps=1.0)
    believed, _ = errors(source, tested=False)
    tested, tracker = errors(source)
    assert np.nanmean(tested[-10:]) < 0.5 * np.nanmean(believed[-10:])
    concern = tracker.velocity_concern()
    assert concern is not None
    assert "of what they state" in str(concern)


def test_an_honest_source_is_believed() -> None:
    source = Source(sigma_mps=0.5, stated_mps=0.5)
    believed, _ = errors(source, tested=False)
    tested, tracker = errors(source)
    np.testing.assert_allclose(np.nanmean(tested), np.nanmean(believed), rtol=0.05)
    assert tracker.velocity_concern() is None


def test_missed_motions_of_an_uncalibrated_source_are_found() -> None:
    source = Source(sigma_mps=0.3, stated_mps=0.3, missed=0.5)
    believed, _ = errors(source, tested=False)
    tested, _ = errors(source)
    assert np.nanmean(tested[-10:]) < 0.5 * np.nanmean(believed[-10:])
