from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mottrack.core import InputError, Objects
from mottrack.trackers.fixed_lag import FixedLagConfig, FixedLagTracker
from mottrack.trackers.fixed_lag.config import FixedLagAssociationConfig

from .conftest import MakeObjects

CAR = (4.0, 2.0)


def stamp(k: int) -> int:
    return (10 + k) * 10**8


@pytest.fixture(params=["gtsam", "numpy"])
def tracker(request: pytest.FixtureRequest) -> FixedLagTracker:
    return FixedLagTracker(FixedLagConfig(engine=request.param))


def test_a_moving_and_a_standing_cluster(tracker: FixedLagTracker, clusters: MakeObjects) -> None:
    for k in range(20):
        tracks = tracker.step(stamp(k), clusters(stamp(k), [(k, 0, *CAR), (5, 20, *CAR)]))
    assert tracks.id.tolist() == [1, 2]
    np.testing.assert_allclose(tracks.velocity_mps, [[10, 0], [0, 0]], atol=0.1)
    np.testing.assert_allclose(tracks.centre_m[:, :2], [[19, 0], [5, 20]], atol=0.05)
    assert tracks.observed.all()
    assert tracks.hull is not None
    window = tracker.smoothed(1, covariance=True)
    assert len(window.stamp_ns) == 11  # one second at 10 Hz, both ends
    np.testing.assert_allclose(window.mean[:, 0], np.arange(9, 20), atol=0.1)


def test_measured_velocity_settles_a_new_track_at_once(clusters: MakeObjects) -> None:
    plain, aided = FixedLagTracker(), FixedLagTracker()
    for k in range(2):
        row = [(k, 0, *CAR)]
        without = plain.step(stamp(k), clusters(stamp(k), row))
        with_flow = aided.step(stamp(k), clusters(stamp(k), row, [(10, 0)]))
    assert abs(with_flow.velocity_mps[0, 0] - 10) < 0.2
    spread = [t.velocity_covariance_m2ps2[0, 0, 0] for t in (with_flow, without)]
    assert spread[0] < spread[1] / 10


def test_one_bad_object_costs_the_others_nothing(
    tracker: FixedLagTracker, clusters: MakeObjects
) -> None:
    twin = FixedLagTracker(tracker.config)
    for k in range(6):
        good = clusters(stamp(k), [(k, 0, *CAR), (0, 30, *CAR)])
        far = clusters(stamp(k), [(k, 0, *CAR), (0, 30, *CAR), (4e6 + k, -4e6, *CAR)])
        if k == 3:
            spread = far.position_covariance_m2.copy()
            spread[2] = 0.0
            far = replace(far, position_covariance_m2=spread)
        ours, expected = tracker.step(stamp(k), far), twin.step(stamp(k), good)
    np.testing.assert_array_equal(ours.state[:2], expected.state)
    np.testing.assert_allclose(ours.state[2, 2:4], [10, 0], atol=0.5)


def test_a_track_survives_a_split(tracker: FixedLagTracker, clusters: MakeObjects) -> None:
    whole, pieces = (0.0, 0.0, 4.0, 2.0), [(-1.4, 0.0, 1.2, 2.0), (1.4, 0.0, 1.2, 2.0)]
    for k in range(20):
        rows = pieces if 8 <= k < 12 else [whole]
        tracks = tracker.step(stamp(k), clusters(stamp(k), rows))
    assert tracks.id.tolist() == [1]
    assert np.hypot(*tracks.velocity_mps[0]) < 0.1


def test_pieces_that_part_become_tracks_with_the_velocity(
    tracker: FixedLagTracker, clusters: MakeObjects
) -> None:
    for k in range(10):
        tracker.step(stamp(k), clusters(stamp(k), [(k, 0.0, 2.0, 2.0)]))
    for k in range(10, 35):
        apart = 0.6 + 0.1 * (k - 9)
        rows = [(k, apart, 1.0, 0.8), (k, -apart, 1.0, 0.8)]
        tracks = tracker.step(stamp(k), clusters(stamp(k), rows))
    assert len(tracks) == 2
    assert 1 in tracks.id
    np.testing.assert_allclose(tracks.velocity_mps[:, 0], [10, 10], atol=2.0)


def test_tracks_survive_a_merge(tracker: FixedLagTracker, clusters: MakeObjects) -> None:
    for k in range(24):
        y = abs(k - 12) * 0.2 + 0.55
        rows = [(k, 0.0, 1.0, 2.2)] if y < 0.8 else [(k, y, 1.0, 0.8), (k, -y, 1.0, 0.8)]
        tracks = tracker.step(stamp(k), clusters(stamp(k), rows))
    assert sorted(tracks.id.tolist()) == [1, 2]


def test_a_track_dies_when_unseen_and_its_identity_is_not_reused(
    tracker: FixedLagTracker, clusters: MakeObjects
) -> None:
    for k in range(4):
        tracker.step(stamp(k), clusters(stamp(k), [(0, 0, *CAR)]))
    for k in range(4, 12):
        assert len(tracker.step(stamp(k), Objects.empty(stamp(k)))) == 0
    for k in range(12, 15):
        tracks = tracker.step(stamp(k), clusters(stamp(k), [(0, 0, *CAR)]))
    assert tracks.id.tolist() == [2]
    with pytest.raises(InputError, match="track_id"):
        tracker.smoothed(1)


def test_boxes_without_hulls_are_tracked_by_class(
    tracker: FixedLagTracker, clusters: MakeObjects
) -> None:
    for k in range(5):
        boxes = replace(
            clusters(stamp(k), [(k, 0, *CAR), (k, 0.4, *CAR)]),
            hull=None,
            position_covariance_m2=None,
            label=np.array(["car", "pedestrian"]),
        )
        tracks = tracker.step(stamp(k), boxes)
    assert tracks.label.tolist() == ["car", "pedestrian"]
    np.testing.assert_allclose(tracks.centre_m[:, 1], [0, 0.4], atol=1e-6)
    assert tracks.hull is None


def test_nearest_neighbour_is_the_papers_rule(clusters: MakeObjects) -> None:
    config = FixedLagConfig(association=FixedLagAssociationConfig(rule="nearest"))
    tracker = FixedLagTracker(config)
    for k in range(5):
        rows = [(0, 0, 0.5, 0.5), (0, 2, 0.5, 0.5)] + ([(0, 0.7, 0.5, 0.5)] if k == 4 else [])
        tracks = tracker.step(stamp(k), clusters(stamp(k), rows))
    assert tracks.id.tolist() == [1, 2]
    np.testing.assert_allclose(tracks.centre_m[:, 1], [0, 2], atol=1e-6)


def test_two_runs_are_equal_to_the_last_bit(clusters: MakeObjects) -> None:
    rng = np.random.default_rng(0)
    frames = [
        clusters(stamp(k), [(*rng.uniform(-20, 20, 2), 1.0, 1.0) for _ in range(30)])
        for k in range(10)
    ]
    runs = []
    for _ in range(2):
        tracker = FixedLagTracker()
        runs.append([tracker.step(f.stamp_ns, f).state for f in frames])
    for one, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(one, other)
