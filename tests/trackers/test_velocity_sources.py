"""Velocities from several sources at once, and from radar Doppler along one axis."""

import numpy as np
import pytest

from mottrack.core.errors import InputError
from mottrack.core.motion import VelocityMeasurement, fuse_velocities
from mottrack.core.objects import Objects
from mottrack.core.pose import Pose
from mottrack.core.velocity_errors import FLOW_ERRORS
from mottrack.trackers import KalmanTracker


def parked_or_passing(velocity: VelocityMeasurement, stamp_ns: int = 0) -> Objects:
    n = len(velocity)
    return Objects(
        stamp_ns=stamp_ns,
        frame="world",
        centre_m=np.column_stack([np.zeros(n), 10.0 * np.arange(n), np.zeros(n)]),
        size_m=np.tile([4.5, 1.9, 1.6], (n, 1)),
        yaw_rad=np.zeros(n),
        label=np.full(n, "car"),
        score=np.full(n, 0.9),
        velocity=velocity,
    )


def test_fusion_is_the_information_sum_and_skips_what_is_missing() -> None:
    a = VelocityMeasurement(
        np.array([[1.0, 0.0], [5.0, 5.0], [0.0, 0.0]]),
        np.tile([[0.5, 0.1], [0.1, 0.3]], (3, 1, 1)),
        np.array([True, False, False]),
    )
    b = VelocityMeasurement(
        np.array([[2.0, 1.0], [3.0, 4.0], [9.0, 9.0]]),
        np.tile([[0.2, -0.1], [-0.1, 0.4]], (3, 1, 1)),
        np.array([True, True, False]),
    )
    fused = fuse_velocities([a, b])
    information = np.linalg.inv(a.covariance_m2ps2[0]) + np.linalg.inv(b.covariance_m2ps2[0])
    np.testing.assert_allclose(fused.covariance_m2ps2[0], np.linalg.inv(information), atol=1e-12)
    np.testing.assert_array_equal(fused.mean_mps[1], [3.0, 4.0])
    np.testing.assert_array_equal(fused.valid, [True, True, False])


def test_two_radars_see_what_one_cannot() -> None:
    velocity = np.array([[8.0, -3.0]])
    beams = [np.array([[np.cos(t), np.sin(t)]]) for t in (0.3, 1.4)]
    parts = [
        VelocityMeasurement.along(b, (velocity * b).sum(axis=1), np.array([0.01])) for b in beams
    ]
    np.testing.assert_allclose(fuse_velocities(parts).mean_mps, velocity, atol=1e-4)
    with pytest.raises(InputError, match="length of direction"):
        VelocityMeasurement.along(2 * beams[0], np.zeros(1), np.ones(1))


@pytest.mark.parametrize("engine", ["block", "filterpy"])
def test_doppler_moves_a_track_along_the_beam_alone(engine: str) -> None:
    tracker = KalmanTracker(KalmanTracker.Config(engine=engine))
    doppler = VelocityMeasurement.along(np.array([[1.0, 0.0]]), np.array([10.0]), np.array([0.04]))
    tracks = tracker.step(0, parked_or_passing(doppler))
    assert tracks.velocity_mps[0, 0] == pytest.approx(10.0, abs=0.2)
    assert tracks.velocity_mps[0, 1] == pytest.approx(0.0, abs=1e-3)
    sideways = tracks.velocity_covariance_m2ps2[0, 1, 1]
    assert sideways > 10 * tracks.velocity_covariance_m2ps2[0, 0, 0]


def test_a_missing_velocity_is_as_none_at_all() -> None:
    absent, none = KalmanTracker(), KalmanTracker()
    for k in range(4):
        objects = parked_or_passing(VelocityMeasurement.absent(3), k * 10**8)
        a, b = (
            absent.step(k * 10**8, objects),
            none.step(k * 10**8, objects.with_velocity(None)),
        )
        np.testing.assert_array_equal(a.state, b.state)
        np.testing.assert_array_equal(a.covariance, b.covariance)


@pytest.mark.parametrize("preset", ["default", "pillarflow"])
def test_a_car_measured_to_stand_still_is_not_stopped(preset: str) -> None:
    ids, lost = set(), []
    for measured in (0.0, 9.0):
        tracker = KalmanTracker(KalmanTracker.Config(preset=preset))
        for k in range(4):
            speed = np.array([[measured if k == 0 else 9.0, 0.0]])
            velocity = VelocityMeasurement(
                speed, 0.1 * np.eye(2)[None], np.ones(1, bool), FLOW_ERRORS
            )
            objects = parked_or_passing(velocity, k * 5 * 10**8)
            moved = Pose.from_yaw(0.0, (4.5 * k, 0.0, 0.0))
            tracks = tracker.step(objects.stamp_ns, objects.transformed(moved, "world"))
        ids |= set(tracks.id.tolist())
        lost.append(tracks.velocity_mps[0, 0])
    assert ids == {1}
    np.testing.assert_allclose(lost, 9.0, atol=1.5)


def test_a_velocity_out_of_this_world_is_left_alone() -> None:
    tracker, plain = KalmanTracker(), KalmanTracker()
    for k in range(3):
        speed = np.full((1, 2), 500.0)
        absurd = VelocityMeasurement(speed, np.eye(2)[None], np.ones(1, bool), FLOW_ERRORS)
        objects = parked_or_passing(absurd, k * 10**8)
        a = tracker.step(k * 10**8, objects)
        b = plain.step(k * 10**8, objects.with_velocity(None))
        if k > 0:
            np.testing.assert_array_equal(a.id, b.id)
    assert np.hypot(*a.velocity_mps[0]) < 100.0


def test_a_parked_car_stands_with_the_flow_that_says_so() -> None:
    """A source that loses motions says of it what it says of those; its boxes tell them apart."""
    rng = np.random.default_rng(3)
    tracker, plain = KalmanTracker(), KalmanTracker()
    with_flow, without = [], []
    for k in range(12):
        rest = VelocityMeasurement(
            rng.normal(0.0, 0.1, (1, 2)), 0.02 * np.eye(2)[None], np.ones(1, bool), FLOW_ERRORS
        )
        place = Pose.from_yaw(0.0, (*rng.normal(0.0, 0.2, 2), 0.0))
        objects = parked_or_passing(rest, k * 5 * 10**8).transformed(place, "world")
        measured = tracker.step(objects.stamp_ns, objects)
        alone = plain.step(objects.stamp_ns, objects.with_velocity(None))
        with_flow.append(np.hypot(*measured.velocity_mps[0]))
        without.append(np.hypot(*alone.velocity_mps[0]))
    assert np.mean(with_flow[2:]) < 0.5 * np.mean(without[2:])
