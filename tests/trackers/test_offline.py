"""Labels of a finished scene: tracklets linked, ghosts dropped, sizes voted."""

from typing import NamedTuple

import numpy as np
import pytest

from mottrack.core.errors import MottrackError
from mottrack.core.objects import Objects, Tracks
from mottrack.trackers import KalmanTracker
from mottrack.trackers.kalman.ghosts import p_real
from mottrack.trackers.kalman.offline import weighted_median

STEP_S = 0.5
FRAMES = 40


class Car(NamedTuple):
    """A car along x in a lane of its own, detected in all frames but those that are hidden."""

    lane_m: float
    start_m: float
    speed_mps: float
    hidden: range


def scene(cars: list[Car], seed: int = 0, false: int = 0) -> list[Objects]:
    """Detections of cars with errors in place and length; `false` ones a frame at random places."""
    rng = np.random.default_rng(seed)
    frames = []
    for k in range(FRAMES):
        seen = [c for c in cars if k not in c.hidden]
        xy = [[c.start_m + c.speed_mps * STEP_S * k, c.lane_m] for c in seen]
        centre = np.array(xy).reshape(-1, 2) + rng.normal(0, 0.15, (len(seen), 2))
        centre = np.vstack([centre, rng.uniform(-150, 150, (false, 2))])
        n = len(centre)
        size = np.tile([4.5, 1.9, 1.6], (n, 1)) * rng.normal(1, 0.05, (n, 3))
        frames.append(
            Objects(
                stamp_ns=round((k + 1) * STEP_S * 1e9),
                frame="world",
                centre_m=np.column_stack([centre, np.zeros(n)]),
                size_m=size,
                yaw_rad=np.zeros(n),
                label=np.array(["car"] * n),
                score=np.append(rng.uniform(0.6, 0.9, n - false), rng.uniform(0.1, 0.4, false)),
            )
        )
    return frames


def finished(frames: list[Objects], **offline: bool) -> list[Tracks]:
    tracker = KalmanTracker(KalmanTracker.Config(offline={"enabled": True, **offline}))
    return tracker.finish([tracker.step(o.stamp_ns, o) for o in frames])


def identities(steps: list[Tracks], lane_m: float) -> set[int]:
    near = [t.id[np.abs(t.centre_m[:, 1] - lane_m) < 2] for t in steps]
    return set(np.concatenate(near).tolist())


# 5.5 s: longer than a track of 14 detections is kept online; at 8 m/s, and parked
GAP = range(14, 25)
CARS = [Car(0, 0, 8.0, GAP), Car(20, 50, 0.0, GAP), Car(40, 0, 12.0, range(0))]
CARS += [Car(-100, 0, 9.0, range(0)), Car(100, 200, 0.0, range(0))]


def test_tracklets_are_linked_across_a_gap_and_the_gap_is_filled() -> None:
    frames = scene(CARS)
    apart, joined = finished(frames, link=False), finished(frames)
    for car in CARS[:2]:
        assert len(identities(apart, car.lane_m)) == 2
        assert len(identities(joined, car.lane_m)) == 1
    middle = joined[19]
    row = np.argmin(np.abs(middle.centre_m[:, 1]))
    assert middle.centre_m[row, 0] == pytest.approx(8.0 * STEP_S * 19, abs=1.5)
    assert not middle.observed[row]


def test_another_car_in_the_place_of_one_that_left_is_not_linked() -> None:
    """The first drives off at 8 m/s; the second starts 100 m behind where the first would be."""
    left, came = Car(0, 0, 8.0, range(14, FRAMES)), Car(0, -20, 8.0, range(0, 20))
    assert len(identities(finished(scene([left, came, CARS[2]])), 0)) == 2


def test_single_false_detections_are_dropped_and_cars_are_kept() -> None:
    lanes = [Car(8.0 * lane, 5.0 * lane, 6.0, range(0)) for lane in range(8)]
    steps = finished(scene(lanes, false=4))
    for car in lanes:
        assert identities(steps, car.lane_m)
    rows = sum(len(step) for step in steps)
    assert FRAMES * len(lanes) <= rows < 1.05 * FRAMES * len(lanes)
    kept = finished(scene(lanes, false=4), remove_ghosts=False)
    assert sum(len(step) for step in kept) > 1.2 * rows


def test_a_track_has_one_size_nearer_the_truth() -> None:
    steps, plain = finished(scene(CARS)), finished(scene(CARS), vote_sizes=False)
    sizes = {i: np.vstack([t.size_m[t.id == i] for t in steps]) for i in steps[0].id.tolist()}
    for size in sizes.values():
        assert np.ptp(size, axis=0).max() == 0
        assert size[0, 0] == pytest.approx(4.5, rel=0.03)
    assert np.ptp(np.vstack([t.size_m[:1] for t in plain]), axis=0).max() > 0


def test_a_scene_too_small_to_tell_keeps_everything() -> None:
    assert finished([]) == []
    (only,) = finished(scene(CARS)[:1])
    assert len(only) == len(CARS)


def test_the_mixture_finds_both_kinds() -> None:
    """Drawn from the law itself: the posterior's error is near Bayes' own."""
    rng = np.random.default_rng(3)
    real = rng.random(2000) < 0.3
    hits = np.where(real, rng.geometric(0.05, 2000), rng.geometric(0.7, 2000))
    score = np.where(real, rng.normal(0.7, 0.1, 2000), rng.normal(0.3, 0.1, 2000))
    assert np.mean((p_real(hits, score) >= 0.5) != real) < 0.03


def test_weighted_median_is_the_plain_one_for_equal_weights() -> None:
    values = np.array([3.0, 1.0, 2.0, 5.0, 4.0])
    assert weighted_median(values, np.ones(5)) == 3.0
    assert weighted_median(values, np.array([0.1, 0.1, 0.1, 9.0, 0.1])) == 5.0


def test_frames_have_no_length_to_bridge() -> None:
    with pytest.raises((MottrackError, ValueError), match="offline needs time in seconds"):
        KalmanTracker.Config(preset="stanford_iprl_tri", offline={"enabled": True})
